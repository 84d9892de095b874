#include "service/contact/solid_node.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "service/contact/fingertip.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The footprint along x or z on nodes first, first + 1, ..., whose period goes on at either end.
struct Along {
  long first = 0;
  Eigen::MatrixX3d weights;  // and their derivatives by the pose
};
Along along(const Fingertip& tip, double at_m, double spacing_m) {
  const double reach = kFootprintReach * tip.footprint_m;
  const auto first = static_cast<long>(std::floor((at_m - reach) / spacing_m)) - 1,
             last = static_cast<long>(std::ceil((at_m + reach) / spacing_m)) + 1;
  std::vector<double> nodes_m;
  for (long n = first; n <= last; ++n) nodes_m.push_back(static_cast<double>(n) * spacing_m);
  const Footprint foot = footprint(tip, at_m, nodes_m, {0, nodes_m.size() - 1});
  return {first + static_cast<long>(foot.first), foot.weights};
}

// Of the weights' product, by the pose.
enum Column : Index { kWeight, kByX, kByZ, kByXX, kByXZ, kByZZ, kColumns };

}  // namespace

SolidTouch touch_node(const SolidGrid& grid, const RecycledCompliance& compliance, const Fingertip& tip,
                      const Vector3& pose) {
  const bool stuck = tip.friction == Friction::kStuck;
  const Along x = along(tip, pose[0], grid.spacing_x_m), z = along(tip, pose[2], grid.spacing_z_m);
  const Index nodes_x = x.weights.rows(), nodes_z = z.weights.rows(), n = nodes_x * nodes_z;
  // Within the period no node is met twice.
  const double width_m = std::max(static_cast<double>(nodes_x) * grid.spacing_x_m,
                                  static_cast<double>(nodes_z) * grid.spacing_z_m);
  require_room(grid, tip, width_m / 4, static_cast<double>(n));
  const auto nx = static_cast<long>(grid.nx), nz = static_cast<long>(grid.nz);
  Eigen::Matrix<double, Eigen::Dynamic, kColumns> weights(n, Index{kColumns});
  std::vector<std::size_t> nodes;
  for (Index k = 0; k < nodes_z; ++k)
    for (Index i = 0; i < nodes_x; ++i) {
      const auto a = x.weights.row(i), b = z.weights.row(k);
      weights.row(i + nodes_x * k) << a[0] * b[0], a[1] * b[0], a[0] * b[1], a[2] * b[0], a[1] * b[1],
          a[0] * b[2];
      const long at_x = x.first + static_cast<long>(i), at_z = z.first + static_cast<long>(k);
      nodes.push_back(static_cast<std::size_t>((at_x % nx + nx) % nx + nx * ((at_z % nz + nz) % nz)));
    }

  SolidTouch out;
  const Index components = stuck ? 3 : 1, normal = stuck ? 1 : 0;
  for (Index c = 0; c < components; ++c)
    for (const std::size_t node : nodes)
      out.contact.patch.unknowns.push_back(static_cast<std::size_t>(c + 1 - normal) * grid.columns() + node);
  const MatrixXd s = compliance.among(out.contact.patch.unknowns);
  // B f and B^T u, B of a column of the weights.
  const auto spread = [&](Column by, const VectorXd& f) -> VectorXd {
    return (weights.col(by) * f.transpose()).reshaped();
  };
  const auto gather = [&](Column by, const VectorXd& u) -> VectorXd {
    return u.reshaped(n, components).transpose() * weights.col(by);
  };
  MatrixXd a(components, components);
  for (Index c = 0; c < components; ++c)
    a.col(c) = gather(kWeight, s * spread(kWeight, VectorXd::Unit(components, c)));
  const Eigen::LLT<MatrixXd> factor(a);
  if (factor.info() != Eigen::Success)
    throw std::domain_error("contact: the compliance under the node is not positive definite");

  const VectorXd push = VectorXd::Unit(components, normal), f = factor.solve(pose[1] * push);
  out.contact.force_n = spread(kWeight, f);
  const VectorXd moved = s * out.contact.force_n;
  SolidEnergy& energy = out.energy;
  energy.value = f[normal] * pose[1] / 2;
  energy.sensitivity.resize(components * n, 3);
  MatrixXd v(components, 3);  // d_q - (B^T S B)_q f
  v.col(1) = push;
  energy.gradient[1] = f[normal];
  for (const auto& [q, by, twice, mixed] :
       {std::tuple{Index{0}, kByX, kByXX, kByXZ}, std::tuple{Index{2}, kByZ, kByZZ, kByXZ}}) {
    const VectorXd slope = spread(by, f), moved_by_slope = s * slope;
    v.col(q) = -gather(by, moved) - gather(kWeight, moved_by_slope);
    energy.gradient[q] = -slope.dot(moved);
    energy.hessian(q, q) = -f.dot(gather(twice, moved)) - slope.dot(moved_by_slope);
    // Both of the two set this one, to the same.
    energy.hessian(0, 2) = energy.hessian(2, 0) =
        -f.dot(gather(mixed, moved)) - spread(by == kByX ? kByZ : kByX, f).dot(moved_by_slope);
    energy.sensitivity.col(q) = slope;
  }
  const MatrixXd by_pose = factor.solve(v);
  energy.hessian += v.transpose() * by_pose;
  energy.hessian = (energy.hessian + energy.hessian.transpose()).eval() / 2;
  energy.sensitivity.col(1).setZero();
  for (Index q = 0; q < 3; ++q) energy.sensitivity.col(q) += spread(kWeight, by_pose.col(q));
  return out;
}

}  // namespace teletact::service
