// Tissues and touches of the plan chart, by seed: voxels of 2 mm, so that nodes 2, 1 and 0.5 mm apart see the
// same tissue. Positions are from the middle of the block's surface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "service/tissue/solid/solid_tissue.h"

namespace teletact::bench {

inline constexpr double kVoxelM = 0.002, kPlanModulusPa = 10e3;

struct PlanPose {
  double x_m = 0, z_m = 0, indentation_m = 0;
};

// A ball; voxels have its share of ln E by how much of them lies in it.
struct PlanLump {
  std::array<double, 3> centre_m{};
  double radius_m = 0, contrast = 1;
};

struct PlanScene {
  std::string kind;
  double depth_m = 0.040, poisson_ratio = 0.49;
  std::vector<PlanLump> lumps{};
  double texture = 0, correlation_m = 0;  // of ln E: deviation, and l of exp(-r^2 / 2 l^2)
  std::vector<PlanPose> poses{};
  std::size_t nx = 0, nz = 0;        // voxels
  std::vector<double> modulus_pa{};  // [y][z][x]

  std::size_t layers() const { return modulus_pa.size() / (nx * nz); }
  // With each voxel cut into so many elements along each side: a power of two.
  service::SolidTissue tissue(std::size_t cuts) const;
};

// Stiffer by the ball.
void add_lump(PlanScene&, const PlanLump&);

// The `index`-th: kinds take turns, the first six are all different. The period is 128 x 64 mm, or 64 x 64
// mm.
PlanScene plan_scene(std::uint64_t seed, std::size_t index, std::size_t poses, bool small);

}  // namespace teletact::bench
