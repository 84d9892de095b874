#include "bench/suites/plan/scenes.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace teletact::bench {
namespace {

constexpr std::array kTurns{"homogeneous", "layers", "lump",    "lumps", "texture",
                            "thin",        "lump",   "texture", "lump",  "layers"};
constexpr std::array kPoissonRatios{0.3, 0.4, 0.45, 0.49, 0.49, 0.49, 0.499, 0.4999};
constexpr double kDeepM = 0.040, kThinM = 0.010;
constexpr double kMinContrast = 0.3, kMaxContrast = 30;
constexpr double kCoverM = 0.001;  // above a lump, at least
constexpr double kMinIndentationM = 5e-4, kMaxIndentationM = 4e-3;

struct Random {
  std::mt19937_64 engine;
  double between(double low, double high) { return low + (high - low) * double(engine() >> 11) * 0x1p-53; }
  double scaled(double low, double high) { return std::exp(between(std::log(low), std::log(high))); }
  std::size_t below(std::size_t n) { return engine() % n; }
};

void add_layers(Random& random, PlanScene& scene) {
  const std::size_t layers = scene.layers(), columns = scene.nx * scene.nz;
  std::vector<double> of(layers, 1);
  for (std::size_t n = 1 + random.below(3); n > 0; --n) {
    const double factor = random.scaled(0.3, 5);
    for (std::size_t j = 1 + random.below(layers - 1); j < layers; ++j) of[j] *= factor;
  }
  for (std::size_t e = 0; e < scene.modulus_pa.size(); ++e) scene.modulus_pa[e] *= of[e / columns];
}

// Near the middle, as deep as there is room for.
PlanLump lump_of(Random& random, const PlanScene& scene, double aside_m) {
  const bool thin = scene.depth_m < kDeepM;
  PlanLump lump{.radius_m = thin ? random.between(0.002, 0.0035) : random.between(0.0025, 0.0075),
                .contrast = random.scaled(kMinContrast, kMaxContrast)};
  const double least = std::max(0.003, lump.radius_m + kCoverM);
  lump.centre_m = {random.between(-aside_m, aside_m), random.between(least, thin ? 0.007 : 0.025),
                   random.between(-aside_m, aside_m)};
  return lump;
}

// White noise, smeared along each axis in turn: around the period, at top and bottom mirrored.
void add_texture(Random& random, PlanScene& scene) {
  scene.texture = random.between(0.05, 0.30), scene.correlation_m = random.between(0.002, 0.005);
  std::normal_distribution<double> normal;
  std::vector<double> field(scene.modulus_pa.size()), next(field.size());
  for (double& value : field) value = normal(random.engine);
  const double sigma = scene.correlation_m / std::numbers::sqrt2 / kVoxelM;
  const auto reach = long(std::ceil(4 * sigma));
  const std::array<long, 3> size{long(scene.nx), long(scene.nz), long(scene.layers())};
  const std::array<long, 3> stride{1, size[0], size[0] * size[1]};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const long n = size[axis];
    for (std::size_t e = 0; e < field.size(); ++e) {
      const long at = long(e) / stride[axis] % n;
      double sum = 0;
      for (long away = -reach; away <= reach; ++away) {
        long to = at + away;
        if (axis < 2)
          to = (to % n + n) % n;
        else
          to = to < 0 ? std::min(-1 - to, n - 1) : to >= n ? std::max(2 * n - 1 - to, 0L) : to;
        sum += std::exp(-double(away * away) / (2 * sigma * sigma)) *
               field[std::size_t(long(e) + (to - at) * stride[axis])];
      }
      next[e] = sum;
    }
    field.swap(next);
  }
  double squares = 0;
  for (const double value : field) squares += value * value;
  const double to_deviation = scene.texture / std::sqrt(squares / double(field.size()));
  for (std::size_t e = 0; e < field.size(); ++e) scene.modulus_pa[e] *= std::exp(to_deviation * field[e]);
}

// Half of them over the lump, if there is one; log-uniform depths.
void add_poses(Random& random, PlanScene& scene, std::size_t count) {
  for (std::size_t n = 0; n < count; ++n) {
    PlanPose pose{random.between(-0.015, 0.015), random.between(-0.010, 0.010),
                  random.scaled(kMinIndentationM, kMaxIndentationM)};
    if (n % 2 == 0 && !scene.lumps.empty()) {
      const PlanLump& lump = scene.lumps[random.below(scene.lumps.size())];
      pose.x_m = lump.centre_m[0] + random.between(-lump.radius_m, lump.radius_m);
      pose.z_m = lump.centre_m[2] + random.between(-lump.radius_m, lump.radius_m);
    }
    scene.poses.push_back(pose);
  }
}

}  // namespace

void add_lump(PlanScene& scene, const PlanLump& lump) {
  constexpr int kPoints = 4;  // along each side of a voxel
  const double x0 = -double(scene.nx) * kVoxelM / 2, z0 = -double(scene.nz) * kVoxelM / 2;
  const auto at = [](std::size_t voxel, int point) {
    return (double(voxel) + (point + 0.5) / kPoints) * kVoxelM;
  };
  for (std::size_t e = 0; e < scene.modulus_pa.size(); ++e) {
    const std::size_t i = e % scene.nx, k = e / scene.nx % scene.nz, j = e / (scene.nx * scene.nz);
    int inside = 0;
    for (int a = 0; a < kPoints; ++a)
      for (int b = 0; b < kPoints; ++b)
        for (int c = 0; c < kPoints; ++c)
          inside += std::hypot(x0 + at(i, a) - lump.centre_m[0], at(j, b) - lump.centre_m[1],
                               z0 + at(k, c) - lump.centre_m[2]) <= lump.radius_m;
    if (inside > 0)
      scene.modulus_pa[e] *= std::pow(lump.contrast, inside / double(kPoints * kPoints * kPoints));
  }
  scene.lumps.push_back(lump);
}

service::SolidTissue PlanScene::tissue(std::size_t cuts) const {
  service::SolidTissue out;
  out.poisson_ratio = poisson_ratio;
  out.grid = {nx * cuts, nz * cuts, kVoxelM / double(cuts), kVoxelM / double(cuts), {}};
  for (std::size_t j = 0; j <= layers() * cuts; ++j)
    out.grid.y_m.push_back(double(j) * kVoxelM / double(cuts));
  out.youngs_modulus_pa.reserve(out.grid.elements());
  for (std::size_t j = 0; j < layers() * cuts; ++j)
    for (std::size_t k = 0; k < nz * cuts; ++k)
      for (std::size_t i = 0; i < nx * cuts; ++i)
        out.youngs_modulus_pa.push_back(modulus_pa[i / cuts + nx * (k / cuts + nz * (j / cuts))]);
  return out;
}

PlanScene plan_scene(std::uint64_t seed, std::size_t index, std::size_t poses, bool small) {
  std::seed_seq mixed{std::uint64_t(seed), std::uint64_t(index)};
  Random random{std::mt19937_64(mixed)};
  PlanScene scene{.kind = kTurns[index % kTurns.size()]};
  scene.poisson_ratio = kPoissonRatios[random.below(kPoissonRatios.size())];
  if (scene.kind == "thin") scene.depth_m = kThinM;
  scene.nx = small ? 32 : 64, scene.nz = 32;
  scene.modulus_pa.assign(scene.nx * scene.nz * std::size_t(std::lround(scene.depth_m / kVoxelM)),
                          kPlanModulusPa);
  const std::size_t thin = scene.kind == "thin" ? random.below(4) : 4;
  if (scene.kind == "layers" || thin == 0) add_layers(random, scene);
  if (scene.kind == "lump" || thin == 1) add_lump(scene, lump_of(random, scene, 0.005));
  if (scene.kind == "lumps")
    for (std::size_t n = 2 + random.below(3); n > 0; --n) add_lump(scene, lump_of(random, scene, 0.012));
  if (scene.kind == "texture" || thin == 2) add_texture(random, scene);
  add_poses(random, scene, poses);
  return scene;
}

}  // namespace teletact::bench
