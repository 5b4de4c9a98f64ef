// OctoMap, ray by ray and as point clouds of 1081 rays, both with lazy inner nodes.
#include "ray_cloud.hpp"
#include <octomap/octomap.h>

namespace {
octomap::point3d point(const double* p) { return {float(p[0]), float(p[1]), float(p[2])}; }

void insert_ray(octomap::OcTree& tree, const Ray& ray) {
    if (ray.hit) {
        tree.insertRay(point(ray.origin), point(ray.end), -1.0, true);
        return;
    }
    octomap::KeyRay keys;
    if (!tree.computeRayKeys(point(ray.origin), point(ray.end), keys)) return;
    for (const auto& key : keys) tree.updateNode(key, false, true);
}

// A ray without return goes in as a point beyond the range, as OctoMap's own server does it: freed up to the range. One
// that was clipped shorter can only go in by itself.
void insert_cloud(octomap::OcTree& tree, const std::vector<Ray>& rays, size_t first, size_t last, double range_m) {
    octomap::Pointcloud cloud;
    for (size_t i = first; i < last; ++i) {
        const octomap::point3d origin = point(rays[i].origin), end = point(rays[i].end);
        const double length = (end - origin).norm();
        if (rays[i].hit) cloud.push_back(end);
        else if (length > 0.999 * range_m) cloud.push_back(origin + (end - origin) * 1.1f);
        else insert_ray(tree, rays[i]);
    }
    tree.insertPointCloud(cloud, point(rays[first].origin), range_m, true, false);
}
}  // namespace

int main(int argc, char** argv) {
    const Arguments a = parse_arguments(argc, argv);
    const std::vector<Ray> rays = read_rays(a);
    report("octomap per ray, lazy", a, rays.size(), [&] {
        octomap::OcTree tree(a.voxel_m);
        for (const Ray& ray : rays) insert_ray(tree, ray);
    });
    report("octomap insertPointCloud, lazy", a, rays.size(), [&] {
        octomap::OcTree tree(a.voxel_m);
        for (size_t i = 0; i < rays.size(); i += 1081) {
            insert_cloud(tree, rays, i, std::min(i + 1081, rays.size()), a.range_m);
        }
    });
}
