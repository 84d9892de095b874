#include "bench/peers/contact_case.h"
#include "service/tissue/tissue_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "tests/reference/elasticity.h"

namespace teletact::bench {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kWidthM = 0.060, kSoftPa = 10e3, kIndentationM = 1e-3;
constexpr double kSquareM = 0.005;                            // of the checkerboard
constexpr double kPorePitchM = 0.010, kPoreRadiusM = 0.0035;  // of the sponge, rows shifted by half a pitch
constexpr int kLayers = 6;

bool in_pore(double x_m, double y_m) {
  const double row = std::floor(y_m / kPorePitchM), shift = std::fmod(row, 2) * kPorePitchM / 2;
  const double dx = std::remainder(x_m - shift - kPorePitchM / 2, kPorePitchM);
  return std::hypot(dx, y_m - (row + 0.5) * kPorePitchM) < kPoreRadiusM;
}

// (x, y) in a tissue kWidthM x depth_m.
bool is_stiff(Pattern pattern, double x_m, double y_m, double depth_m) {
  const double smaller = std::min(kWidthM, depth_m);
  switch (pattern) {
    case Pattern::kNodule:
      return std::hypot(x_m - 0.45 * kWidthM, y_m - 0.4 * depth_m) < smaller / 5;
    case Pattern::kCheckerboard:
      return std::fmod(std::floor(x_m / kSquareM) + std::floor(y_m / kSquareM), 2) != 0;
    case Pattern::kSponge:
      return !in_pore(x_m, y_m);
    case Pattern::kLayered:
      return static_cast<int>(kLayers * y_m / depth_m) % 2 == 1;
  }
  throw std::invalid_argument("pattern: unknown");
}

// Nodes that a tip of this radius touches; too many where it reaches past the tissue.
std::size_t touched_nodes(const service::TissueModel& model, double radius_m,
                          const service::PlanePose& pose) {
  service::Fingertip tip;
  tip.radius_m = radius_m;
  try {
    return service::solve_contact(model.problem(), 0, *model.compliance(0), tip, pose).pressure.size();
  } catch (const std::out_of_range&) {
    return std::numeric_limits<std::size_t>::max();
  }
}

double find_radius_m(const reference::TouchedTissue& tissue, const service::PlanePose& pose,
                     std::size_t nodes) {
  const service::TissueModel model(tissue.grid, tissue.material, tissue.supports, {});
  double low = 1e-5, high = 10;
  for (int step = 0; step < 60; ++step) {
    const double middle = std::sqrt(low * high);
    const std::size_t touched = touched_nodes(model, middle, pose);
    if (touched == nodes) return middle;
    (touched < nodes ? low : high) = middle;
  }
  throw std::invalid_argument(
      fmt::format("contact_nodes is {}: no tip touches so many on {} columns", nodes, tissue.grid.nx()));
}

}  // namespace

const char* to_string(Pattern pattern) {
  switch (pattern) {
    case Pattern::kNodule:
      return "nodule";
    case Pattern::kCheckerboard:
      return "checkerboard";
    case Pattern::kSponge:
      return "sponge";
    case Pattern::kLayered:
      return "layered";
  }
  throw std::invalid_argument("pattern: unknown");
}

std::string describe(const ContactCase& c) {
  return fmt::format("{}x{} nu {} contrast {} {}{}", c.columns, c.rows, c.poisson_ratio, c.contrast,
                     to_string(c.pattern), c.stretch == 1 ? "" : fmt::format(" stretch {}", c.stretch));
}

reference::TouchedTissue make_tissue(const ContactCase& c) {
  reference::TouchedTissue tissue;
  const double width_m = kWidthM / static_cast<double>(c.columns - 1), height_m = width_m * c.stretch;
  const double depth_m = height_m * static_cast<double>(c.rows - 1);
  tissue.grid.x_m = service::uniform_coordinates(0, kWidthM, c.columns - 1);
  tissue.grid.y_m = service::uniform_coordinates(0, depth_m, c.rows - 1);
  tissue.material.poisson_ratio = c.poisson_ratio;
  for (std::size_t j = 0; j + 1 < c.rows; ++j)
    for (std::size_t i = 0; i + 1 < c.columns; ++i) {
      const double x_m = (static_cast<double>(i) + 0.5) * width_m;
      const double y_m = (static_cast<double>(j) + 0.5) * height_m;
      tissue.material.youngs_modulus_pa.push_back(
          is_stiff(c.pattern, x_m, y_m, depth_m) ? kSoftPa * c.contrast : kSoftPa);
    }
  return tissue;
}

std::array<double, 2> ContactProblem::force_n(const VectorXd& multiplier_n_m) const {
  return {tissue.thickness_m * multiplier_n_m.dot(slope),
          tissue.thickness_m * axial_share * multiplier_n_m.sum()};
}

double ContactProblem::force_error(const std::array<double, 2>& force) const {
  return std::hypot(force[0] - truth.force_n[0], force[1] - truth.force_n[1]) /
         std::hypot(truth.force_n[0], truth.force_n[1]);
}

double ContactProblem::displacement_error(const VectorXd& displacement_m) const {
  if (!displacement_m.allFinite()) return std::numeric_limits<double>::quiet_NaN();
  return (displacement_m - truth.displacement_m).lpNorm<Eigen::Infinity>() /
         truth.displacement_m.lpNorm<Eigen::Infinity>();
}

ContactProblem make_problem(const ContactCase& c) {
  ContactProblem p;
  p.of = c;
  p.tissue = make_tissue(c);
  const service::TissueGrid& grid = p.tissue.grid;
  p.pose = {0.5 * kWidthM + 0.3 * grid.x_m[1], kIndentationM};
  p.tip.radius_m = find_radius_m(p.tissue, p.pose, c.contact_nodes);
  p.truth = reference::touch(p.tissue, p.tip, p.pose, reference::KktMethod::kSparseFactor);
  p.stiffness = reference::with_fixed(reference::assemble(grid, p.tissue.material),
                                      reference::fixed_dofs(grid, p.tissue.supports));
  const auto size = static_cast<Index>(p.truth.columns.size());
  p.overlap_m.resize(size);
  p.slope.resize(size);
  for (Index r = 0; r < size; ++r) {
    const std::size_t column = p.truth.columns[static_cast<std::size_t>(r)];
    const double d = grid.x_m[column] - p.pose.x_m;
    p.contact_dofs.push_back(2 * grid.node(column, 0) + 1);
    p.overlap_m[r] = p.truth.displacement_m[static_cast<Index>(p.contact_dofs.back())];
    p.slope[r] = d / p.tip.radius_m;
  }
  p.axial_share = p.truth.force_n[1] / (p.tissue.thickness_m * p.truth.multiplier_n_m.sum());
  return p;
}

}  // namespace teletact::bench
