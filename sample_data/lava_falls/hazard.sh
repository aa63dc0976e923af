# From the terrain model to a hazard indication map; sh hazard.sh does all steps.
set -e
mpmgis release --dem lava_falls_dem_utm12n_10m.tif --scenario frequent --slope-max 45 --ridge-angle 8 --min-area 20000 --forest forest.geojson --snow-depth 30=0.9,100=1.2,300=1.5 --snow-altitude 1500 -o areas.gpkg
mpmgis friction-map --dem lava_falls_dem_utm12n_10m.tif --table friction.csv -o friction
mpmgis region hazard_30.toml --releases areas.gpkg -o region_30
mpmgis region hazard_100.toml --releases areas.gpkg -o region_100
mpmgis region hazard_300.toml --releases areas.gpkg -o region_300
mpmgis report --map swiss-avalanche --scenario 30=region_30 --scenario 100=region_100 --scenario 300=region_300 --dem lava_falls_dem_utm12n_10m.tif --title "Exercise at Lava Falls, no hazard map" -o map
mpmgis exposure region_30 region_100 region_300 --objects objects.geojson -o exposure
