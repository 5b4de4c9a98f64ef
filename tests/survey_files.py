"""Reads every file of a survey with the programs that others use; fails where one of them is not as it should be."""

import glob
import json
import sys

import laspy
import numpy as np
import pyogrio
import rasterio
from rio_cogeo.cogeo import cog_validate

folder = sys.argv[1]
UNITS = {
    "dtm": "m", "dtm_sd": "m", "chm": "m", "brush": "m", "slope": "degree", "brush_density": "1", "evidence": "1",
    "traversability": "1",
}
rasters = sorted(glob.glob(f"{folder}/*.tif"))
assert len(rasters) == 8, rasters
for path in rasters:
    valid, errors, warnings = cog_validate(path)
    assert valid and not errors and not warnings, (path, errors, warnings)
    with rasterio.open(path) as raster:
        assert "EGM96 height" in raster.crs.to_wkt() and "UTM zone 17N" in raster.crs.to_wkt(), path
        assert raster.overviews(1) and raster.nodata is not None, path
        assert raster.units[0] == UNITS[path.split("/")[-1][:-4]] and all(raster.descriptions), (path, raster.units)
        assert raster.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG", path

with rasterio.open(f"{folder}/dtm.tif") as dtm:
    heights, shape = dtm.read(1, masked=True), dtm.shape
    millimetres = heights.compressed().astype(float) * 1000
    assert np.abs(millimetres - np.round(millimetres)).max() < 0.1
with rasterio.open(f"{folder}/brush.tif") as brush, rasterio.open(f"{folder}/brush_density.tif") as dense:
    height, density = brush.read(1, masked=True), dense.read(1, masked=True)
    assert 0 < density.max() <= 1 and density.min() == 0 and (density.filled(0) > 0).sum() > 100
    assert (height.filled(0) > 0)[density.filled(0) > 0].all()
with rasterio.open(f"{folder}/traversability.tif") as costs:
    cost, reason = costs.read(1), costs.read(2)
    assert costs.count == 2 and ((cost == 255) == (reason == 255)).all() and reason[reason != 255].max() <= 9

layers = {name for name, _ in pyogrio.list_layers(f"{folder}/objects.gpkg")}
assert layers == {"trees", "rejected", "drops", "rocks", "walls", "brush", "layer_styles"}, layers
trees = pyogrio.raw.read(f"{folder}/objects.gpkg", layer="trees")
styles = pyogrio.raw.read(f"{folder}/objects.gpkg", layer="layer_styles")
assert len(styles[3][0]) == 6

cloud = laspy.read(f"{folder}/cloud.laz")
assert str(cloud.header.version) == "1.4" and cloud.header.point_format.id == 6
assert cloud.header.parse_crs().to_authority() is None and "EGM96" in cloud.header.parse_crs().name
assert set(np.unique(cloud.classification)) <= {1, 2, 3, 4, 5, 6, 7, 64}
assert cloud.tree_id.max() <= len(trees[2]) and (cloud.tree_id > 0).any()
assert cloud.gps_time.max() > cloud.gps_time.min()
print(json.dumps({"trees": len(trees[2]), "points": len(cloud), "cells": int(heights.count()), "shape": shape}))
