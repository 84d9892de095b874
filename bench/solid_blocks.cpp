#include "bench/solid_blocks.h"

#include <cmath>
#include <map>
#include <random>

#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

constexpr double kGrowth = 1.03;

// Of texture: cubes along x, y, z.
constexpr double kCubeM = 0.004;
constexpr std::size_t kCubesX = 32, kCubesY = 10, kCubesZ = 16;

}  // namespace

service::SolidGrid solid_grid(std::size_t nx, std::size_t nz, std::size_t layers, double spacing_x_m,
                              double spacing_z_m) {
  return {nx, nz, spacing_x_m, spacing_z_m, service::graded_rows(kSolidDepthM, layers, kGrowth)};
}
service::SolidGrid solid_13k() {
  return solid_grid(32, 32, 13, 0.002, 0.002);
}
service::SolidGrid solid_70k() {
  return solid_grid(64, 32, 34, 0.002, 0.002);
}
service::SolidGrid solid_336k() {
  return solid_grid(128, 64, 41, 0.001, 0.001);
}

service::SolidTissue solid_tissue(const service::SolidGrid& grid, double poisson_ratio, const SolidLump& lump,
                                  double texture, std::uint64_t seed) {
  std::mt19937_64 engine(seed);
  std::normal_distribution<double> normal;
  std::vector<double> ln(kCubesX * kCubesY * kCubesZ);
  for (double& value : ln) value = texture * normal(engine);
  const double middle_x = double(grid.nx) * grid.spacing_x_m / 2,
               middle_z = double(grid.nz) * grid.spacing_z_m / 2;
  const auto cube = [](double at, std::size_t count) {
    return std::min(static_cast<std::size_t>(at / kCubeM), count - 1);
  };
  return service::solid(grid, poisson_ratio, [&](double x, double y, double z) {
    const double away =
        std::hypot(x - middle_x - lump.centre_m[0], y - lump.centre_m[1], z - middle_z - lump.centre_m[2]);
    return kSolidModulusPa * (away <= lump.radius_m ? lump.contrast : 1) *
           std::exp(ln[cube(x, kCubesX) + kCubesX * (cube(z, kCubesZ) + kCubesZ * cube(y, kCubesY))]);
  });
}

SurfaceValues hertz_load(const service::SolidGrid& grid) {
  constexpr double kRadiusM = 0.004, kForceN = 0.14;
  constexpr int kSamples = 80;  // along the radius; each is shared by the element's four nodes
  std::map<std::size_t, double> forces;
  double sum = 0;
  for (int a = -kSamples; a < kSamples; ++a)
    for (int b = -kSamples; b < kSamples; ++b) {
      const double x = (a + 0.5) / kSamples, z = (b + 0.5) / kSamples, inside = 1 - x * x - z * z;
      if (inside <= 0) continue;
      const double pressure = std::sqrt(inside);
      const double at_x = x * kRadiusM / grid.spacing_x_m + double(grid.nx / 2),
                   at_z = z * kRadiusM / grid.spacing_z_m + double(grid.nz / 2);
      const double i = std::floor(at_x), k = std::floor(at_z);
      for (int dx = 0; dx < 2; ++dx)
        for (int dz = 0; dz < 2; ++dz)
          forces[surface_unknown(grid, long(i) + dx, long(k) + dz, 1)] +=
              pressure * std::abs(1 - dx - (at_x - i)) * std::abs(1 - dz - (at_z - k));
      sum += pressure;
    }
  SurfaceValues load;
  load.values.resize(Eigen::Index(forces.size()));
  for (const auto& [unknown, force] : forces) {
    load.values[Eigen::Index(load.unknowns.size())] = kForceN * force / sum;
    load.unknowns.push_back(unknown);
  }
  return load;
}

}  // namespace teletact::bench
