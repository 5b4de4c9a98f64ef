"""A small plot of random truth and random results in the layouts that score.py reads: TRUTH FOUND SEED."""
import json, os, sys
import numpy as np
import rasterio
from rasterio.transform import from_origin

truth, found, seed = sys.argv[1], sys.argv[2], int(sys.argv[3])
rng = np.random.default_rng(seed)
os.makedirs(truth), os.makedirs(found)
X0, Y0, SIZE = 369000.0, 3279000.0, 12.0
cells = int(SIZE / 0.15)

# Trees close together, so that a greedy matching would go wrong.
trees = rng.uniform(0, SIZE, (40, 2)) + [X0, Y0]
with open(f"{truth}/trees.csv", "w") as f:
    f.write("tree_id,x,y,z,x_bh,y_bh,dbh,height,stem_hits\n")
    for k, (x, y) in enumerate(trees):
        f.write(f"{k},{x:.4f},{y:.4f},40,{x:.4f},{y:.4f},{rng.uniform(.05, .5):.4f},{rng.uniform(5, 20):.3f},9\n")
with open(f"{found}/trees.csv", "w") as f:
    f.write("id,easting,northing,ground_z,dbh_m,dbh_std_m,height_m,confidence\n")
    for k, (x, y) in enumerate(np.r_[trees + rng.normal(0, .15, trees.shape), rng.uniform(-2, SIZE + 2, (15, 2)) + [X0, Y0]]):
        dbh, std = (f"{rng.uniform(.05, .5):.3f}" if k % 7 else ""), (f"{rng.uniform(.01, .2):.3f}" if k % 5 else "")
        f.write(f"{k},{x:.3f},{y:.3f},40,{dbh},{std},{rng.uniform(5, 20):.3f},1\n")

z = (40 + rng.normal(0, .2, (cells, cells))).astype("f4")
np.savez_compressed(f"{truth}/ground.npz", z=z, x0=X0, y0=Y0, cell=0.15, hits=rng.integers(0, 3, z.shape).astype(np.int32), size=12)
np.savetxt(f"{truth}/scans.csv", [[0, X0 + 6, Y0 + 6, 41.6, 40]], fmt="%.4f", delimiter=",", header="scan,x,y,z,ground_z", comments="")
json.dump({"config": {"seed": seed}}, open(f"{truth}/meta.json", "w"))

count = 20000
kind = np.dtype([("p", "<f8", 3), ("t", "<f8"), ("n", "<f4", 3), ("c", "u1", 4)])
rays = np.zeros(count, kind)
rays["p"] = rng.uniform([-1, -1, 39.5], [SIZE + 1, SIZE + 1, 44], (count, 3)) + [X0, Y0, 0]
rays["n"], rays["c"] = 1.0, 255
np.save(f"{truth}/labels.npy", rng.choice([0, 1, 5, 5], count).astype(np.uint8))
names = ["double x", "double y", "double z", "double time", "float nx", "float ny", "float nz"] + [f"uchar {c}" for c in ("red", "green", "blue", "alpha")]
with open(f"{truth}/rays.ply", "wb") as f:
    head = "".join(f"property {n}\n" for n in names)
    f.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{head}end_header\n".encode())
    rays.tofile(f)

# Rasters that end within the plot, with holes.
shape = dict(height=cells - 10, width=cells + 20, count=1, dtype="float32", nodata=-9999.0, compress="deflate", predictor=3,
             transform=from_origin(X0 - 1.5, Y0 + SIZE, 0.15, 0.15), crs="EPSG:32617", tiled=True, blockxsize=64, blockysize=64)
for name, mean in (("dtm", 40.0), ("brush", 0.4)):
    values = (mean + rng.normal(0, .2, (cells - 10, cells + 20))).astype("f4")
    values[rng.random(values.shape) < .1] = -9999.0
    with rasterio.open(f"{found}/{name}.tif", "w", driver="GTiff", **shape) as f:
        f.write(values, 1)
