"""Maps of a run for other programs: tables, GeoTIFF, meshes with attributes, a digital shape kernel, and panels."""
