#include "bench/independent/pressed_block.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace teletact::bench {
namespace {

// Stress is singular at the face's edges, and elements are small there.
Hexahedra mesh_of(const Block& block) {
  constexpr double kEdge = .00008, kGrowth = 1.2, kGrowthInto = .8, kUnderFace = .0025, kSphere = .0014,
                   kDeep = .0035, kFar = 1;
  const double x_edge = block.face_width_m / 2, z_edge = block.face_across_m / 2;
  const auto size = [&](double growth_m, double from_sphere_m, double limit_m) {
    const bool by_sphere = block.contrast != 1 && std::abs(from_sphere_m) < .6 * block.sphere_m;
    return std::min(by_sphere ? kSphere : limit_m, kEdge + growth_m);
  };
  const auto along = [&](double edge_m, double under_face_m) {
    return [=](double at_m) {
      return size(kGrowth * std::abs(at_m - edge_m), at_m, at_m < edge_m ? under_face_m : kFar);
    };
  };
  const auto into = [&](double y) {
    return size(kGrowthInto * y, y - block.sphere_depth_m, y < .6 * block.depth_m ? kUnderFace : kDeep);
  };
  std::vector<double> layers{0, block.depth_m};
  if (block.pad_m > 0) layers.insert(layers.begin() + 1, block.pad_m);
  return Hexahedra({graded_lines({0, x_edge, block.width_m / 2}, along(x_edge, kUnderFace)),
                    graded_lines(layers, into),
                    graded_lines({0, z_edge, block.across_m / 2}, along(z_edge, kFar))});
}

}  // namespace

double Block::true_modulus(double x_m, double y_m, double z_m) const {
  const bool inside = std::hypot(x_m, y_m - sphere_depth_m, z_m) < sphere_m / 2;
  return modulus_pa * (inside ? contrast : y_m < pad_m ? pad_contrast : 1);
}

PressedBlock::PressedBlock(const Block& block) : block_(block), mesh_(mesh_of(block)) {
  const Hexahedra::Moduli moduli_pa =
      mesh_.means([&](const Hexahedra::Point& p) { return block.true_modulus(p.x(), p.y(), p.z()); });
  const auto solve = [&](bool tilted) {
    constexpr double kNear = 1e-9, kFree = std::numeric_limits<double>::quiet_NaN();
    Eigen::Matrix3Xd prescribed_m = Eigen::Matrix3Xd::Constant(3, mesh_.size(), kFree);
    for (Eigen::Index n = 0; n < mesh_.size(); ++n) {
      auto u = prescribed_m.col(n);
      const Hexahedra::Point& p = mesh_.node(n);
      if (p.x() < kNear) u = tilted ? Eigen::Vector3d(kFree, 0, 0) : Eigen::Vector3d(0, kFree, kFree);
      if (p.z() < kNear) u.z() = 0;
      if (p.y() > block.depth_m - kNear) u.setZero();
      if (p.y() > kNear || p.x() > block.face_width_m / 2 + kNear || p.z() > block.face_across_m / 2 + kNear)
        continue;
      if (block.bonded_face) u.setZero();
      u.y() = tilted ? block.tilt * p.x() : block.push_m;
    }
    return mesh_.solve(moduli_pa, block.poisson_ratio, prescribed_m);
  };
  const Hexahedra::Solution pushed = solve(false);
  pushed_m_ = pushed.displacement_m;
  for (Eigen::Index n = 0; n < mesh_.size(); ++n)
    if (mesh_.node(n).y() == 0) force_n_ += 4 * pushed.force_n(1, n);
  if (block.tilt != 0) tilted_m_ = solve(true).displacement_m;
}

Eigen::Vector2d PressedBlock::at(double x_m, double y_m) const {
  const Hexahedra::Point p(std::abs(x_m), y_m, 0);
  const double side = x_m < 0 ? -1 : 1;
  const auto pushed = mesh_.at(p, pushed_m_);
  Eigen::Vector2d u(side * pushed.x() + block_.tilt * y_m, pushed.y() - block_.push_m - block_.tilt * x_m);
  if (block_.tilt == 0) return u;
  const auto tilted = mesh_.at(p, tilted_m_);
  return u + Eigen::Vector2d(tilted.x(), side * tilted.y());
}

}  // namespace teletact::bench
