// OpenVDB with a value accessor and its DDA: log-odds a voxel, clamped, as mapping packages on it do.
#include "ray_cloud.hpp"
#include <openvdb/math/DDA.h>
#include <openvdb/math/Ray.h>
#include <openvdb/openvdb.h>

namespace {
using RayD = openvdb::math::Ray<double>;
constexpr float hit_step = 0.85f, miss_step = -0.41f, low = -2.0f, high = 3.5f;

void add(openvdb::FloatGrid::Accessor& accessor, const openvdb::Coord& voxel, float step) {
    accessor.modifyValueAndActiveState(voxel, [step](float& value, bool& active) {
        value = std::clamp(value + step, low, high);
        active = value > 0.0f;
    });
}

void insert_ray(openvdb::FloatGrid::Accessor& accessor, const Ray& ray, double voxel_m) {
    const openvdb::Vec3d start(ray.origin[0] / voxel_m, ray.origin[1] / voxel_m, ray.origin[2] / voxel_m);
    const openvdb::Vec3d end(ray.end[0] / voxel_m, ray.end[1] / voxel_m, ray.end[2] / voxel_m);
    openvdb::Vec3d direction = end - start;
    const double length = direction.length();
    if (length <= 0.0) return;
    direction /= length;
    const openvdb::Coord last = openvdb::Coord::floor(end);
    openvdb::math::DDA<RayD, 0> dda(RayD(start, direction, 0.0, length), 0.0, length);
    do {
        const openvdb::Coord voxel = dda.voxel();
        if (voxel == last) break;
        add(accessor, voxel, miss_step);
    } while (dda.step());
    add(accessor, last, ray.hit ? hit_step : miss_step);
}
}  // namespace

int main(int argc, char** argv) {
    const Arguments a = parse_arguments(argc, argv);
    const std::vector<Ray> rays = read_rays(a);
    openvdb::initialize();
    report("openvdb accessor and dda", a, rays.size(), [&] {
        auto grid = openvdb::FloatGrid::create(0.0f);
        auto accessor = grid->getAccessor();
        for (const Ray& ray : rays) insert_ray(accessor, ray, a.voxel_m);
    });
}
