// Reads a ray cloud (binary little-endian PLY, a vertex a ray) for the peers' benchmarks.
//
// In: x y z end point, time, nx ny nz back to the sensor, alpha 0 = no return. Out: rays in metres relative to the
// first ray's sensor, cut to a range as our mapper cuts them: a ray longer than the range becomes one without return.
#pragma once
#include <algorithm>
#include <ctime>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

struct Ray {
    double origin[3];
    double end[3];
    bool hit;
};

struct Arguments {
    std::string file;
    double voxel_m = 0.15;
    double range_m = 20.0;
    int repeat = 5;
};

inline Arguments parse_arguments(int argc, char** argv) {
    Arguments a;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        const auto next = [&] { return i + 1 < argc ? argv[++i] : (std::cerr << word << " wants a value\n", std::exit(2), ""); };
        if (word == "--voxel") a.voxel_m = std::atof(next());
        else if (word == "--range") a.range_m = std::atof(next());
        else if (word == "--repeat") a.repeat = std::atoi(next());
        else a.file = word;
    }
    if (a.file.empty()) {
        std::cerr << "usage: " << argv[0] << " RAYS.ply [--voxel 0.15] [--range 20] [--repeat 5]\n";
        std::exit(2);
    }
    return a;
}

// Only the layout that our own tools write: doubles x y z time, floats nx ny nz, four bytes of colour.
inline std::vector<Ray> read_rays(const Arguments& a) {
    std::ifstream in(a.file, std::ios::binary);
    std::string line;
    long count = -1;
    std::vector<std::string> properties;
    while (std::getline(in, line) && line != "end_header") {
        std::istringstream words(line);
        std::string first, second, third;
        words >> first >> second >> third;
        if (first == "element" && second == "vertex") count = std::atol(third.c_str());
        if (first == "property") properties.push_back(second + " " + third);
    }
    const std::vector<std::string> expected = {"double x", "double y", "double z", "double time", "float nx", "float ny",
                                               "float nz", "uchar red", "uchar green", "uchar blue", "uchar alpha"};
    if (count < 0 || properties != expected) {
        std::cerr << a.file << ": not the ray cloud layout that tsense writes\n";
        std::exit(6);
    }
    constexpr size_t stride = 4 * 8 + 3 * 4 + 4;
    std::vector<char> bytes(count * stride);
    in.read(bytes.data(), bytes.size());
    if (in.gcount() != static_cast<std::streamsize>(bytes.size())) {
        std::cerr << a.file << ": truncated\n";
        std::exit(6);
    }
    std::vector<Ray> rays(count);
    double base[3] = {0, 0, 0};
    for (long i = 0; i < count; ++i) {
        const char* p = bytes.data() + i * stride;
        double end[3];
        float back[3];
        std::memcpy(end, p, 24);
        std::memcpy(back, p + 32, 12);
        Ray& r = rays[i];
        r.hit = static_cast<unsigned char>(p[47]) > 0;
        double length = 0;
        for (int k = 0; k < 3; ++k) length += double(back[k]) * back[k];
        length = std::sqrt(length);
        const double keep = std::min(1.0, a.range_m / std::max(length, 1e-9));
        r.hit = r.hit && keep >= 1.0;
        for (int k = 0; k < 3; ++k) {
            const double origin = end[k] + back[k];
            // Whole metres, so that voxels lie where ours do.
            if (i == 0) base[k] = std::floor(origin);
            r.origin[k] = origin - base[k];
            r.end[k] = r.origin[k] - back[k] * keep;
        }
    }
    return rays;
}

// Processor time of this process, seconds: other programs cost it caches, but not time.
inline double seconds() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return now.tv_sec + now.tv_nsec * 1e-9;
}

// Runs `insert_all` on a fresh map `repeat` times; prints the median as a line of JSON.
template <typename Run>
void report(const char* engine, const Arguments& a, size_t beams, Run run) {
    std::vector<double> ns;
    for (int i = 0; i < a.repeat; ++i) {
        const double start = seconds();
        run();
        const double took = seconds() - start;
        ns.push_back(took * 1e9 / beams);
    }
    std::sort(ns.begin(), ns.end());
    std::printf("{\"engine\": \"%s\", \"beams\": %zu, \"voxel_m\": %g, \"ns_per_beam\": %.1f}\n", engine, beams, a.voxel_m,
                ns[ns.size() / 2]);
    std::fflush(stdout);
}
