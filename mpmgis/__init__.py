"""mpmgis: landslides, debris flows, snow and ice avalanches on real terrain with the Material Point Method."""

__version__ = "0.1.0"
