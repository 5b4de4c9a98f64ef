// MRPT's dense 8-bit grid, ray by ray. Its steps are 26-connected: it visits about two thirds of the voxels.
#include "ray_cloud.hpp"
#include <mrpt/maps/COccupancyGridMap3D.h>

int main(int argc, char** argv) {
    const Arguments a = parse_arguments(argc, argv);
    const std::vector<Ray> rays = read_rays(a);
    double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
    for (const Ray& ray : rays) {
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min({low[k], ray.origin[k], ray.end[k]});
            high[k] = std::max({high[k], ray.origin[k], ray.end[k]});
        }
    }
    const mrpt::math::TPoint3D corner(low[0] - 1, low[1] - 1, low[2] - 1), opposite(high[0] + 1, high[1] + 1, high[2] + 1);
    mrpt::maps::COccupancyGridMap3D map(corner, opposite, a.voxel_m);
    report("mrpt dense grid", a, rays.size(), [&] {
        for (const Ray& ray : rays) {
            map.insertRay({ray.origin[0], ray.origin[1], ray.origin[2]}, {ray.end[0], ray.end[1], ray.end[2]}, ray.hit);
        }
    });
}
