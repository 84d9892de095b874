#include "service/contact/fingertip.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "service/base/choices.h"

namespace teletact::service {

namespace {

void require_positive(double value, const char* field) {
  if (!(value > 0) || !std::isfinite(value)) {
    throw std::invalid_argument(
        fmt::format("fingertip.{} is {}; give a finite length above 0 m", field, value));
  }
}

constexpr double kSteepSphere = 0.9;  // of its radius

Rise on_sphere(double radius_m, double distance_m) {
  const double at = std::min(distance_m, kSteepSphere * radius_m), rest = distance_m - at;
  const double height = std::sqrt(radius_m * radius_m - at * at);
  Rise r{radius_m - height, at / height, radius_m * radius_m / (height * height * height)};
  r.m += rest * (r.slope + rest * r.curvature_1_m / 2);
  r.slope += rest * r.curvature_1_m;
  return r;
}

Footprint hat_function(double x_m, std::span<const double> grid, ColumnRange columns) {
  Footprint f;
  if (columns.first == columns.last) {
    f.first = columns.first;
    f.weights.setZero(1, 3);
    f.weights(0, 0) = 1;
    return f;
  }
  const auto begin = grid.begin() + columns.first, end = grid.begin() + columns.last;
  const std::size_t right =
      std::size_t(std::clamp(std::upper_bound(begin, end, x_m), begin + 1, end) - grid.begin());
  const std::size_t left = right - 1;
  const double h = grid[right] - grid[left], t = (x_m - grid[left]) / h;
  constexpr double kAtNode = 1e-9;
  const bool at_left = t < kAtNode && left > columns.first;
  const bool at_right = t > 1 - kAtNode && right < columns.last;
  f.first = at_left ? left - 1 : left;
  f.weights.setZero(at_left || at_right ? 3 : 2, 3);
  const Eigen::Index l = at_left ? 1 : 0;
  f.weights(l, 0) = 1 - t;
  f.weights(l + 1, 0) = t;
  // Slopes of the two elements beside the node, averaged where X lies on it.
  const double share = at_left || at_right ? 0.5 : 1;
  f.weights(l, 1) -= share / h;
  f.weights(l + 1, 1) += share / h;
  if (at_left || at_right) {
    const std::size_t a = at_left ? left - 1 : right;
    const double beside = grid[a + 1] - grid[a];
    f.weights(Eigen::Index(a - f.first), 1) -= share / beside;
    f.weights(Eigen::Index(a - f.first) + 1, 1) += share / beside;
  }
  return f;
}

Footprint gaussian(double sigma, double x_m, std::span<const double> grid, ColumnRange columns) {
  const auto begin = grid.begin() + columns.first, end = grid.begin() + columns.last + 1;
  const auto low = std::lower_bound(begin, end, x_m - kFootprintReach * sigma);
  const auto high = std::upper_bound(low, end, x_m + kFootprintReach * sigma);
  Footprint f;
  f.first = std::size_t(low - grid.begin());
  const Eigen::Index n = high - low;
  f.weights.setZero(n, 3);
  double widest = 0;
  Eigen::Array3d sum = Eigen::Array3d::Zero();  // of g, g', g''
  for (Eigen::Index k = 0; k < n; ++k) {
    const double d = low[k] - x_m, s2 = sigma * sigma;
    const double width = tributary_width_m(grid, f.first + std::size_t(k));
    const double g = width * std::exp(-d * d / (2 * s2));
    f.weights.row(k) << g, g * d / s2, g * (d * d / s2 - 1) / s2;
    sum += f.weights.row(k).transpose().array();
    widest = std::max(widest, width);
  }
  constexpr double kRounding = 1e-9;
  if (n < 3 || sigma < (0.5 - kRounding) * widest) {
    throw std::invalid_argument(
        fmt::format("fingertip.footprint_m is {}, below half of the node spacing here; use 0 (hat function) "
                    "or at least {}",
                    sigma, 0.5 * widest));
  }
  // b = g / G;  b' = (g' - b G') / G;  b'' = (g'' - 2 b' G' - b G'') / G.
  f.weights.col(0) /= sum[0];
  f.weights.col(1) = (f.weights.col(1) - f.weights.col(0) * sum[1]) / sum[0];
  f.weights.col(2) = (f.weights.col(2) - 2 * f.weights.col(1) * sum[1] - f.weights.col(0) * sum[2]) / sum[0];
  return f;
}

}  // namespace

void validate(const Fingertip& tip) {
  if (tip.shape == FingertipShape::kNode) {
    if (!(tip.footprint_m >= 0) || !std::isfinite(tip.footprint_m)) {
      throw std::invalid_argument(
          fmt::format("fingertip.footprint_m is {}; give 0 (hat function) or a standard deviation in metres",
                      tip.footprint_m));
    }
    return;
  }
  require_positive(tip.radius_m, "radius_m");
  const bool round = tip.shape == FingertipShape::kRoundedTip || tip.shape == FingertipShape::kSphere;
  if (!round) require_positive(tip.half_width_m, "half_width_m");
  if (tip.shape == FingertipShape::kPad && !(tip.pad_m_pa > 0 && std::isfinite(tip.pad_m_pa)))
    throw std::invalid_argument(fmt::format(
        "fingertip.pad_m_pa is {}; give the pad's thickness over its modulus, above 0 m/Pa", tip.pad_m_pa));
}

double flat_half_m(const Fingertip& tip) {
  return tip.shape == FingertipShape::kFlatPunch || tip.shape == FingertipShape::kPad ? tip.half_width_m : 0;
}

Rise rise(const Fingertip& tip, double distance_m) {
  if (tip.shape == FingertipShape::kSphere) return on_sphere(tip.radius_m, distance_m);
  const double flat = flat_half_m(tip), d = std::max(0.0, distance_m - flat);
  return {d * d / (2 * tip.radius_m), d / tip.radius_m, d == 0 && flat > 0 ? 0 : 1 / tip.radius_m};
}

NodeOverlap<2> overlap(const Fingertip& tip, const PlanePose& pose, double x_m) {
  const double d = x_m - pose.x_m;
  const Rise r = rise(tip, std::abs(d));
  NodeOverlap<2> o;
  o.w_m = pose.indentation_m - r.m;
  o.slope[0] = std::copysign(r.slope, d);
  o.curvature(0, 0) = -r.curvature_1_m;
  return o;
}

double reach_m(const Fingertip& tip, double indentation_m, double margin_m) {
  if (tip.shape == FingertipShape::kSphere) {
    const double r = tip.radius_m, m = std::max(0.0, indentation_m + margin_m);
    const Rise steep = on_sphere(r, kSteepSphere * r);
    if (m <= steep.m) return std::sqrt(m * (2 * r - m));
    const double c = steep.curvature_1_m, s = steep.slope;
    return kSteepSphere * r + (std::sqrt(s * s + 2 * c * (m - steep.m)) - s) / c;
  }
  return flat_half_m(tip) + std::sqrt(2 * tip.radius_m * std::max(0.0, indentation_m + margin_m));
}

std::string coarse_mesh(const Fingertip& tip, double indentation_m, double spacing_m) {
  if (tip.shape == FingertipShape::kNode || indentation_m <= 0) return "";
  const double reach = reach_m(tip, std::max(indentation_m, choices::kLightTouch), 0);
  // A pad's rim bears little: the whole of it must span enough.
  const bool pad = tip.shape == FingertipShape::kPad;
  const double spans = pad ? reach : reach - flat_half_m(tip);
  if (spans >= (pad ? choices::kMinPadSpacings : choices::kMinSpacings) * spacing_m) return "";
  return fmt::format(
      "the mesh is too coarse for this tip: nodes {:.2g} mm apart where {} spans {:.2g} mm a side; the force "
      "depends on where it stands between them, use a finer grid or a wider tip",
      1e3 * spacing_m, pad ? "it" : "its curved part", 1e3 * spans);
}

Footprint footprint(const Fingertip& tip, double x_m, std::span<const double> grid_x_m, ColumnRange columns) {
  return tip.footprint_m > 0 ? gaussian(tip.footprint_m, x_m, grid_x_m, columns)
                             : hat_function(x_m, grid_x_m, columns);
}

double tributary_width_m(std::span<const double> grid_x_m, std::size_t i) {
  const std::size_t left = i > 0 ? i - 1 : 0, right = std::min(i + 1, grid_x_m.size() - 1);
  return (grid_x_m[right] - grid_x_m[left]) / 2;
}

SkinThickness skin_thickness(const Fingertip& tip, double indentation_m, double width_m) {
  const double d = indentation_m, h = width_m;
  const double round = std::sqrt(2 * tip.radius_m * d);
  const double by_d = tip.radius_m / round, by_d2 = -by_d / (2 * d);  // of the half overlap flat + round
  const double sum = h + flat_half_m(tip) + round, share = h / sum;
  const double share_by_d = -share * by_d / sum;
  const double share_by_d2 = -share * by_d2 / sum + 2 * share * by_d * by_d / (sum * sum);
  return {d * share, share + d * share_by_d, 2 * share_by_d + d * share_by_d2};
}

SkinState skin_state(double p, double stiffness, double thickness_m) {
  const double load = p / (stiffness * thickness_m);  // (1 - s)^2 / s
  const double root = std::sqrt(load * (load + 4)), s = 2 / (load + 2 + root);
  SkinState state;
  state.s = s;
  state.rest = s * (load + root) / 2;  // without cancellation
  state.gap_m = thickness_m * (s - kSkinMiddle);
  state.compliance = s * s / (state.rest * (1 + s) * stiffness);
  state.gap_by_t = 2 * s / (1 + s) - kSkinMiddle;
  return state;
}

SkinEnergy skin_energy(const SkinState& state, double p, double stiffness, double thickness_m) {
  const double excess = -state.rest - std::log(state.s), square = state.rest * state.rest;  // s - 1 - ln s
  return {stiffness * thickness_m * thickness_m * (excess - square / 2) + p * state.gap_m,
          2 * stiffness * thickness_m * excess - kSkinMiddle * p,
          2 * stiffness * (excess - square / (1 + state.s))};
}

}  // namespace teletact::service
