/* Search page: guide before functions, and text beside every hit. Sphinx puts this before its own script. */
var Scorer = {
  score: ([page, title, anchor, description, score, file, kind]) => {
    const words = queryWords();
    const text = (PAGE_TEXTS[page] || []).map(([, part]) => part).join(" ").toLowerCase();
    const times = words.reduce((sum, word) => sum + text.split(word).length - 1, 0);
    const often = kind === "text" ? Math.min(Math.log2(1 + times), 6) : 0;
    if (page.startsWith("api/")) return score + often - 20;
    if (/^(changelog|decisions|contributing|architecture|cases)/.test(page)) return score + often - 16;
    return score + often;
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};

const LENGTH = 240;  // of the text beside a hit

function queryWords() {
  const query = new URLSearchParams(window.location.search).get("q") || "";
  return query.toLowerCase().split(/\s+/).filter((word) => word.length > 1);
}

function textBeside(page, anchor) {
  const parts = PAGE_TEXTS[page] || [];
  const own = parts.filter(([id, text]) => `#${id}` === anchor && text).map(([, text]) => text);
  const words = queryWords();
  const named = parts.map(([, text]) => text).filter((text) => words.some((word) => text.toLowerCase().includes(word)));
  const text = own[0] || named[0] || (parts.find(([, part]) => part) || ["", ""])[1];
  const places = words.map((word) => text.toLowerCase().indexOf(word)).filter((place) => place >= 0);
  let start = places.length ? Math.max(Math.min(...places) - LENGTH / 3, 0) : 0;
  if (start) start = text.indexOf(" ", start) + 1;
  return (start ? "... " : "") + text.substring(start, start + LENGTH) + (start + LENGTH < text.length ? " ..." : "");
}

new MutationObserver((changes) => {
  for (const change of changes) {
    for (const item of change.addedNodes) {
      if (item.nodeName !== "LI" || !item.closest("#search-results")) continue;
      const [file, anchor] = item.querySelector("a").getAttribute("href").split("#");
      const text = textBeside(file.replace(/\.html$/, ""), anchor ? `#${anchor}` : "");
      if (!text) continue;
      const shown = item.appendChild(document.createElement("p"));
      shown.className = "context";
      shown.textContent = text;
    }
  }
}).observe(document.documentElement, { childList: true, subtree: true });
