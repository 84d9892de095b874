#include "service/contact/solid_patch.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <tuple>

#include "service/base/choices.h"
#include "service/contact/fingertip.h"

namespace teletact::service {

namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::VectorXd;
using Three = Eigen::Vector3d;

NodeOverlap<3> overlap(const Fingertip& tip, double indentation_m, double dx, double dz) {
  const double r = std::hypot(dx, dz);
  const Rise up = rise(tip, r);
  const Three plane(1, 0, 1);
  NodeOverlap<3> o;
  o.w_m = indentation_m - up.m;
  if (!(up.slope > 0)) {
    o.curvature = Matrix3d((-up.curvature_1_m * plane).asDiagonal());
    return o;
  }
  const Three out(dx / r, 0, dz / r);
  o.slope += up.slope * out;
  const Matrix3d radial = out * out.transpose();
  o.curvature = -up.curvature_1_m * radial - up.slope / r * (Matrix3d(plane.asDiagonal()) - radial);
  return o;
}

void find_nodes(const SolidGrid& grid, const Fingertip& tip, const Vector3& pose, double margin_m,
                SolidPatch& patch) {
  const double reach = reach_m(tip, pose[1], margin_m);
  const auto nx = static_cast<long>(grid.nx), nz = static_cast<long>(grid.nz);
  // Half of the period: beyond, the nearest copy of one node under the tip would be that of another.
  require_room(grid, tip, reach, std::numbers::pi * reach * reach / (grid.spacing_x_m * grid.spacing_z_m));
  const auto first = [&](double centre, double spacing) {
    return std::lround(std::ceil((centre - reach) / spacing));
  };
  const auto last = [&](double centre, double spacing) {
    return std::lround(std::floor((centre + reach) / spacing));
  };
  for (long k = first(pose[2], grid.spacing_z_m); k <= last(pose[2], grid.spacing_z_m); ++k)
    for (long i = first(pose[0], grid.spacing_x_m); i <= last(pose[0], grid.spacing_x_m); ++i) {
      const NodeOverlap<3> o = overlap(tip, pose[1], static_cast<double>(i) * grid.spacing_x_m - pose[0],
                                       static_cast<double>(k) * grid.spacing_z_m - pose[2]);
      if (o.w_m < -margin_m) continue;
      patch.nodes.push_back(static_cast<std::size_t>((i % nx + nx) % nx + nx * ((k % nz + nz) % nz)));
      patch.overlaps.push_back(o);
    }
}

void tie_sideways(const SolidGrid& grid, double compliance_m_n, SolidPatch& patch) {
  for (std::size_t n = 0; n < patch.nodes.size(); ++n) {
    const auto share = tie_share(patch.overlaps[n].w_m);
    if (!share) continue;
    for (const std::size_t component : {std::size_t{0}, std::size_t{2}}) {
      patch.unknowns.push_back(component * grid.columns() + patch.nodes[n]);
      patch.node_of.push_back(n);
      patch.tie.push_back(*share * compliance_m_n);
    }
  }
}

}  // namespace

void require_room(const SolidGrid& grid, const Fingertip& tip, double reach_m, double nodes) {
  if (4 * reach_m >= static_cast<double>(grid.nx) * grid.spacing_x_m ||
      4 * reach_m >= static_cast<double>(grid.nz) * grid.spacing_z_m)
    throw std::out_of_range(
        "contact: the tip is too wide for the block of tissue; use a smaller one or press less");
  if (nodes * (tip.friction == Friction::kStuck ? 3 : 1) > static_cast<double>(choices::kMaxPatchUnknowns))
    throw std::out_of_range(fmt::format(
        "contact: some {:.0f} nodes are under the tip, more than can be solved in time; use a smaller tip, "
        "a coarser grid, or press less",
        nodes));
}

SolidPatch patch_under(const SolidGrid& grid, const RecycledCompliance& compliance, const Fingertip& tip,
                       const Vector3& pose, double margin_m) {
  SolidPatch patch;
  find_nodes(grid, tip, pose, margin_m, patch);
  if (patch.nodes.empty()) return patch;
  if (tip.friction == Friction::kStuck) tie_sideways(grid, compliance.layered(0), patch);
  const auto tied = static_cast<Index>(patch.tie.size());
  for (std::size_t n = 0; n < patch.nodes.size(); ++n) {
    patch.unknowns.push_back(grid.columns() + patch.nodes[n]);
    patch.node_of.push_back(n);
  }
  PatchProgramme& q = patch.programme;
  q.a = compliance.among(patch.unknowns);
  q.w = VectorXd::Zero(q.a.rows());
  for (Index t = 0; t < tied; ++t) q.a(t, t) += patch.tie[static_cast<std::size_t>(t)];
  // A pad gives way node by node, sideways by its shear: it keeps its volume.
  if (tip.shape == FingertipShape::kPad) patch.pad_m_n = tip.pad_m_pa / (grid.spacing_x_m * grid.spacing_z_m);
  for (Index u = 0; u < q.a.rows(); ++u) q.a(u, u) += (u < tied ? 3 : 1) * patch.pad_m_n;
  for (std::size_t n = 0; n < patch.nodes.size(); ++n)
    q.w[tied + static_cast<Index>(n)] = patch.overlaps[n].w_m;
  // By the layered tissue's compliance: with the recycled one the skin would change with every pair.
  q.stiffness.assign(patch.nodes.size(), kSkinStiffness / compliance.layered(1));
  patch.skin = skin_thickness(tip, pose[1], std::sqrt(grid.spacing_x_m * grid.spacing_z_m));
  q.thickness_m.assign(patch.nodes.size(), patch.skin.t_m);
  return patch;
}

double min_overlap_m(const SolidPatch& patch, const PatchSolution& s) {
  double least = HUGE_VAL;
  const Index tied = patch.programme.first_node();
  for (std::size_t n = 0; n < patch.nodes.size(); ++n)
    if (s.p[tied + static_cast<Index>(n)] > 0) least = std::min(least, patch.overlaps[n].w_m);
  return least;
}

SolidEnergy energy_of(const SolidPatch& patch, const PatchSolution& s) {
  SolidEnergy energy;
  const PatchProgramme& q = patch.programme;
  const Index tied = q.first_node(), active = static_cast<Index>(s.active.size());
  Eigen::MatrixX3d v(active, 3);
  energy.value = s.p.dot(q.w) - s.p.dot(q.a * s.p) / 2;
  for (Index row = 0; row < active; ++row) {
    const Index unknown = s.active[static_cast<std::size_t>(row)];
    const double p = s.p[unknown];
    const std::size_t node = patch.node_of[static_cast<std::size_t>(unknown)];
    const NodeOverlap<3>& o = patch.overlaps[node];
    if (unknown < tied) {
      v.row(row) = add_tie(p, patch.tie[static_cast<std::size_t>(unknown)], o, energy);
      continue;
    }
    const SkinEnergy w = skin_energy(s.skin[node], p, q.stiffness[node], patch.skin.t_m);
    v.row(row) = add_node(p, o, s.skin[node], w, patch.skin, energy);
  }
  energy.sensitivity = v;
  for (Index c = 0; c < 3; ++c) s.factor.solve(energy.sensitivity.col(c));
  energy.hessian += v.transpose() * energy.sensitivity;
  energy.hessian = (energy.hessian + energy.hessian.transpose()).eval() / 2;
  return energy;
}

LinearisedContact linearise(const SolidPatch& patch, const PatchSolution& s) {
  LinearisedContact out;
  const auto active = static_cast<Index>(s.active.size());
  const Index tied = patch.programme.first_node();
  out.patch.skin_m_n.resize(active);
  out.w_m = VectorXd::Zero(active);
  out.force_n = s.p(s.active);
  for (Index row = 0; row < active; ++row) {
    const Index unknown = s.active[static_cast<std::size_t>(row)];
    out.patch.unknowns.push_back(patch.unknowns[static_cast<std::size_t>(unknown)]);
    if (unknown < tied) {
      out.patch.skin_m_n[row] = patch.tie[static_cast<std::size_t>(unknown)] + 3 * patch.pad_m_n;
      continue;
    }
    const SkinState& skin = s.skin[patch.node_of[static_cast<std::size_t>(unknown)]];
    out.patch.skin_m_n[row] = skin.compliance + patch.pad_m_n;
    out.w_m[row] = patch.programme.w[unknown] + skin.gap_m + skin.compliance * s.p[unknown];
  }
  return out;
}

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
