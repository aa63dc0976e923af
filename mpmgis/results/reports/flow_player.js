// Plays the flow in a report: draws a step on the map, and the values of a place over time.
(async () => {
  const element = (name) => document.getElementById("player-" + name);
  const say = (text) => { element("value").textContent = text; };
  if (typeof DecompressionStream === "undefined") {
    say("This browser is too old for the player (Chrome 80, Firefox 113, Safari 16.4 or later); the maps below show the largest values.");
    return;
  }
  const content = JSON.parse(element("content").textContent);
  const decoded = async (text) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  };
  const cells = new Int32Array(await decoded(content.cells));
  const [rows, columns] = content.shape;
  const [west, south, east, north] = content.bounds;
  for (const band of content.bands) {  // colour of each whole number, as the browser stores it: alpha, blue, green, red
    band.read = [];
    band.colours = new Uint32Array(65536);
    let one = 0;
    for (let number = 0; number < content.none; number++) {
      while (band.classes[one].upper !== null && number * band.precision > band.classes[one].upper) one++;
      const colour = band.classes[one].colour;
      if (colour === null) continue;
      const [red, green, blue] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
      band.colours[number] = ((Math.round(255 * band.classes[one].opacity) << 24) | (blue << 16) | (green << 8) | red) >>> 0;
    }
  }
  const grouped = (metres) => metres.toLocaleString("en", {minimumFractionDigits: 1, maximumFractionDigits: 1}).replaceAll(",", "\u202f");
  const values = async (band, step) => band.read[step] ??= new Uint16Array(await decoded(band.steps[step]));

  await Bokeh.embed.embed_item(JSON.parse(element("drawing").textContent), "player-map");
  const drawing = Bokeh.documents.at(-1);
  const [flow, place, curve, now, over] = ["flow", "place", "values", "now", "curve"].map((name) => drawing.get_model_by_name(name));
  const Picture = flow.data.image[0].constructor;
  let band = content.bands[0], step = 0, spot = null, drawn = 0;

  async function tell() {
    if (spot === null) return;
    const [x, y] = spot.at, parts = [];
    for (const one of content.bands) {
      const code = spot.cell < 0 ? content.none : (await values(one, step))[spot.cell];
      parts.push(one.word + " " + (code === content.none ? "none" : (code * one.precision).toFixed(one.decimals) + " " + one.unit));
    }
    say(`E ${grouped(x)} N ${grouped(y)}, t = ${content.times[step]} s: ${parts.join(", ")}`);
  }
  async function draw() {
    const order = ++drawn, codes = await values(band, step);
    if (order !== drawn) return;  // a later step was asked for
    const picture = new Uint32Array(rows * columns);
    for (let k = 0; k < cells.length; k++) picture[cells[k]] = band.colours[codes[k]];
    flow.data = {image: [new Picture(picture, [rows, columns])]};
    element("time").textContent = `t = ${content.times[step]} s`;
    now.location = Number(content.times[step]);
    await tell();
  }
  async function trace() {
    over.title.text = `${band.words} [${band.unit}]` + (spot === null ? ": click on the flow" : " at the place");
    if (spot === null) return;
    const along = [];
    for (let k = 0; k < content.times.length; k++) {
      const code = spot.cell < 0 ? content.none : (await values(band, k))[spot.cell];
      along.push(code === content.none ? NaN : code * band.precision);
    }
    over.y_range.end = 1.05 * Math.max(band.precision, ...along.filter(Number.isFinite));
    curve.data = {time: content.times.map(Number), value: along};
  }
  function legend() {
    element("legend").replaceChildren(`${band.words}: `);
    for (const one of band.classes.filter((entry) => entry.colour !== null)) {
      const entry = document.createElement("span"), square = document.createElement("span");
      entry.className = "entry";
      square.className = "square";
      square.style.background = one.colour;
      entry.append(square, one.label);
      element("legend").append(entry, " ");
    }
  }
  document.addEventListener("player-tap", async ({detail: [x, y]}) => {
    const column = Math.floor((x - west) / (east - west) * columns), row = Math.floor((y - south) / (north - south) * rows);
    const inside = column >= 0 && column < columns && row >= 0 && row < rows;
    spot = {at: [x, y], cell: inside ? cells.indexOf(row * columns + column) : -1};
    place.data = {x: [x], y: [y]};
    await tell();
    await trace();
  });
  element("step").addEventListener("input", () => { step = Number(element("step").value); draw(); });
  for (const [k, button] of document.getElementsByName("player-band").entries()) {
    button.addEventListener("change", () => { band = content.bands[k]; legend(); draw(); trace(); });
  }
  let timer = null;
  element("play").addEventListener("click", () => {
    if (timer !== null) {
      clearInterval(timer);
      timer = null;
      element("play").textContent = "Play";
      return;
    }
    element("play").textContent = "Pause";
    timer = setInterval(() => {
      step = (step + 1) % content.times.length;
      element("step").value = step;
      draw();
    }, 150);
  });
  legend();
  await draw();
  await trace();
})().catch((error) => {
  document.getElementById("player-value").textContent = `The player does not run in this browser: ${error}`;
  throw error;
});
