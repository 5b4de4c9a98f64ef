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

void insert_cloud(octomap::OcTree& tree, const std::vector<Ray>& rays, size_t first, size_t last) {
    octomap::Pointcloud cloud;
    for (size_t i = first; i < last; ++i) {
        if (rays[i].hit) cloud.push_back(point(rays[i].end));
        else insert_ray(tree, rays[i]);
    }
    tree.insertPointCloud(cloud, point(rays[first].origin), -1.0, true, false);
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
        for (size_t i = 0; i < rays.size(); i += 1081) insert_cloud(tree, rays, i, std::min(i + 1081, rays.size()));
    });
}
