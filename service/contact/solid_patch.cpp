#include "service/contact/solid_patch.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "service/base/choices.h"
#include "service/contact/fingertip.h"
#include "service/contact/skin.h"

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

}  // namespace teletact::service
