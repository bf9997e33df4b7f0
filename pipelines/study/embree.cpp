// Measures Embree 4 on triangles and rays that the ray bench has dumped.
//
// In: FOLDER THREADS PASSES MODE(medium|robust) N…, files FOLDER/N.triangles and FOLDER/N.rays. Out: comma-separated values as
// the bench prints them. One call per ray; batches, passes and best times as in tests/bench/rays.rs.
//
// The few functions and structs of Embree's API are declared here (Embree 4.x, rtcore_ray.h and rtcore_scene.h), because
// the Python wheel has the library without its headers.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

extern "C" {
struct alignas(16) RTCRay {
  float origin[3], tnear, direction[3], time, tfar;
  uint32_t mask, id, flags;
};
struct alignas(16) RTCRayHit {
  RTCRay ray;
  float normal[3], u, v;
  uint32_t primitive, geometry, instance, rest[8];  // more than any 4.x release writes
};
using Handle = void *;
Handle rtcNewDevice(const char *config);
int rtcGetDeviceError(Handle device);
Handle rtcNewScene(Handle device);
void rtcSetSceneFlags(Handle scene, int flags);
void rtcSetSceneBuildQuality(Handle scene, int quality);
void rtcCommitScene(Handle scene);
void rtcReleaseScene(Handle scene);
Handle rtcNewGeometry(Handle device, int type);
void rtcSetSharedGeometryBuffer(Handle geometry, int type, unsigned slot, int format, const void *data, size_t offset,
                                size_t stride, size_t count);
void rtcCommitGeometry(Handle geometry);
unsigned rtcAttachGeometry(Handle scene, Handle geometry);
void rtcReleaseGeometry(Handle geometry);
void rtcIntersect1(Handle scene, RTCRayHit *ray, void *arguments);
void rtcOccluded1(Handle scene, RTCRay *ray, void *arguments);
}

constexpr int TRIANGLE = 0, INDEX = 0, VERTEX = 1, UINT3 = 0x5003, FLOAT3 = 0x9003, MEDIUM = 1, ROBUST = 4;
constexpr size_t BATCH = 250;
constexpr unsigned NONE = ~0u;

struct Line {
  float origin[3], direction[3], far, near;
};

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

template <class T>
std::vector<T> load(const std::string &path) {
  FILE *file = std::fopen(path.c_str(), "rb");
  if (!file) {
    std::fprintf(stderr, "error: cannot read %s\n", path.c_str());
    std::exit(1);
  }
  std::fseek(file, 0, SEEK_END);
  std::vector<T> out(size_t(std::ftell(file)) / sizeof(T));
  std::rewind(file);
  if (std::fread(out.data(), sizeof(T), out.size(), file) != out.size()) std::exit(1);
  std::fclose(file);
  return out;
}

Handle build(Handle device, const std::vector<float> &corners, const std::vector<uint32_t> &indices, int flags) {
  Handle scene = rtcNewScene(device), geometry = rtcNewGeometry(device, TRIANGLE);
  rtcSetSceneFlags(scene, flags);
  rtcSetSceneBuildQuality(scene, MEDIUM);
  rtcSetSharedGeometryBuffer(geometry, VERTEX, 0, FLOAT3, corners.data(), 0, 12, corners.size() / 3);
  rtcSetSharedGeometryBuffer(geometry, INDEX, 0, UINT3, indices.data(), 0, 12, indices.size() / 3);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

// Time of a ray [ns] and the number of rays for which the work is true.
std::pair<double, size_t> measure(const std::vector<Line> &lines, int threads, int passes,
                                  const std::function<size_t(const Line *, const Line *)> &work) {
  const size_t batches = (lines.size() + BATCH - 1) / BATCH;
  std::vector<double> best(batches, std::numeric_limits<double>::infinity());
  std::atomic<size_t> hits{0};
  for (int pass = 0; pass < passes; ++pass) {
    std::atomic<size_t> next{0};
    hits = 0;
    auto worker = [&] {
      for (size_t b; (b = next++) < batches;) {
        const Line *first = lines.data() + b * BATCH;
        const Line *last = lines.data() + std::min(lines.size(), (b + 1) * BATCH);
        const double start = now();
        hits += work(first, last);
        best[b] = std::min(best[b], now() - start);
      }
    };
    std::vector<std::thread> pool;
    for (int i = 0; i < threads; ++i) pool.emplace_back(worker);
    for (auto &thread : pool) thread.join();
  }
  double sum = 0;
  for (double b : best) sum += b;
  return {sum / double(lines.size()) * 1e9, hits};
}

void set(RTCRay &ray, const Line &line, float end) {
  std::memcpy(ray.origin, line.origin, sizeof ray.origin);
  std::memcpy(ray.direction, line.direction, sizeof ray.direction);
  ray.tnear = 0;
  ray.time = 0;
  ray.tfar = end;
  ray.mask = NONE;
  ray.id = ray.flags = 0;
}

int main(int count, char **words) {
  if (count < 6) {
    std::fprintf(stderr, "usage: embree FOLDER THREADS PASSES medium|robust N...\n");
    return 2;
  }
  const std::string folder = words[1], mode = words[4];
  const int threads = std::atoi(words[2]), passes = std::atoi(words[3]);
  Handle device = rtcNewDevice(("threads=" + std::to_string(threads)).c_str());
  for (int k = 5; k < count; ++k) {
    const auto corners = load<float>(folder + "/" + words[k] + ".triangles");
    const auto lines = load<Line>(folder + "/" + words[k] + ".rays");
    std::vector<uint32_t> indices(corners.size() / 3);
    for (size_t i = 0; i < indices.size(); ++i) indices[i] = uint32_t(i);
    double seconds = std::numeric_limits<double>::infinity();
    Handle scene = nullptr;
    for (int pass = 0; pass < passes; ++pass) {
      if (scene) rtcReleaseScene(scene);
      const double start = now();
      scene = build(device, corners, indices, mode == "robust" ? ROBUST : 0);
      seconds = std::min(seconds, now() - start);
    }
    const auto closest = measure(lines, threads, passes, [&](const Line *line, const Line *last) {
      size_t hits = 0;
      for (; line != last; ++line) {
        RTCRayHit query;
        set(query.ray, *line, line->far);
        query.geometry = query.instance = NONE;
        rtcIntersect1(scene, &query, nullptr);
        hits += query.geometry != NONE;
      }
      return hits;
    });
    const auto occlusion = measure(lines, threads, passes, [&](const Line *line, const Line *last) {
      size_t hits = 0;
      for (; line != last; ++line) {
        RTCRay query;
        set(query, *line, line->near);
        rtcOccluded1(scene, &query, nullptr);
        hits += query.tfar < 0;
      }
      return hits;
    });
    std::printf("%zu,%d,%.4f,0,0,%.0f,%.0f,%zu,%zu\n", indices.size() / 3, threads, seconds, closest.first,
                occlusion.first, closest.second, occlusion.second);
    std::fflush(stdout);
    rtcReleaseScene(scene);
  }
  return rtcGetDeviceError(device) == 0 ? 0 : 1;
}
