"""The folder of an export: GeoTIFF of steps and maxima, pictures, films, xarray datasets."""
