#include "service/scene/felt_elements.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace teletact::service {
namespace {

// Share of the force that is borne within t radii of depth: a contact with Hertz's pressure on 40 mm, radii 1
// to 10 mm.
double borne_within(double t) {
  return t * t / (t * t + 0.35 * t + 1.6);
}

// At one depth, of what is borne up to so far to one side: Student's distribution of four degrees.
double borne_up_to(double t) {
  const double tail = 1 + t * t / 4;
  return 0.5 + 0.375 * t / std::sqrt(tail) * (1 - t * t / (12 * tail));
}
// The first moment of the same.
double moment_up_to(double t) {
  const double tail = 1 + t * t / 4;
  return -0.5 / (tail * std::sqrt(tail));
}
// Half of what is borne at a depth lies within hypot(kHalf radius, kHalfOfDepth depth).
constexpr double kHalf = 0.6, kHalfOfDepth = 0.33, kQuartile = 0.7407;  // of Student's distribution
constexpr double kReach = 5;  // widths: 1 % is borne beyond, by the outermost elements

// A column, or row, of nodes_m in which it lies, or the nearest.
std::size_t element_of(const std::vector<double>& nodes_m, double at_m) {
  const auto above = std::upper_bound(nodes_m.begin() + 1, nodes_m.end() - 1, at_m);
  return static_cast<std::size_t>(above - nodes_m.begin()) - 1;
}

}  // namespace

FeltElements::FeltElements(const std::vector<double>& x_m, const std::vector<double>& y_m,
                           const FeltPlace& at)
    : all_columns_(x_m.size() - 1), z_m_(at.z_m), radius_m_(at.radius_m) {
  const std::size_t rows = y_m.size() - 1;
  const auto width_m = [&](double away_m) { return std::hypot(kHalf * at.radius_m, kHalfOfDepth * away_m); };
  const double reach_m =
      kReach * width_m(std::max(std::abs(y_m.front() - at.depth_m), std::abs(y_m.back() - at.depth_m)));
  first_ = element_of(x_m, at.x_m - reach_m);
  columns_ = element_of(x_m, at.x_m + reach_m) + 1 - first_;
  share_.assign(columns_ * rows, 0);
  // To both sides of a layer inside the tissue alike.
  const auto borne_above = [&](double y) {
    return std::copysign(borne_within(std::abs(y - at.depth_m) / at.radius_m), y - at.depth_m);
  };
  const double all = borne_above(y_m.back()) - borne_above(y_m.front());
  for (std::size_t j = 0; j < rows; ++j) {
    const double of_row = (borne_above(y_m[j + 1]) - borne_above(y_m[j])) / all,
                 scale = kQuartile / width_m(std::abs((y_m[j] + y_m[j + 1]) / 2 - at.depth_m));
    scale_.push_back(scale);
    double before = 0;
    for (std::size_t i = 0; i < columns_; ++i) {
      const double up_to = i + 1 < columns_ ? borne_up_to(scale * (x_m[first_ + i + 1] - at.x_m)) : 1;
      share_[i + columns_ * j] = of_row * (up_to - before);
      before = up_to;
    }
  }
}

double FeltElements::across(std::size_t row, double z_m) const {
  constexpr double kFar = 1e6;
  return std::clamp(scale_[row] * (z_m - z_m_), -kFar, kFar);
}

double FeltElements::before(std::size_t row, double z_m) const {
  return borne_up_to(across(row, z_m));
}

double FeltElements::moment_before(std::size_t row, double z_m) const {
  return moment_up_to(across(row, z_m)) / scale_[row];
}

std::vector<std::vector<double>> FeltElements::told_by(const std::vector<double>& planes_m) const {
  std::vector<std::vector<double>> out(planes_m.size(), std::vector<double>(scale_.size(), 0.0));
  for (std::size_t j = 0; j < scale_.size(); ++j) {
    double up_to = out[0][j] = before(j, planes_m[0]);
    for (std::size_t n = 1; n < out.size(); ++n) {
      const double begin_m = planes_m[n - 1], end_m = planes_m[n];
      const double next = before(j, end_m), borne = next - std::exchange(up_to, next),
                   moment = moment_before(j, end_m) - moment_before(j, begin_m),
                   after = std::clamp((moment + (z_m_ - begin_m) * borne) / (end_m - begin_m), 0.0, borne);
      out[n][j] += after, out[n - 1][j] += borne - after;
    }
    out.back()[j] += 1 - up_to;
  }
  return out;
}

double left_of_local(double radius_m, double length_m) {
  constexpr double kByRadius = 4;  // within 6 % for radii of 1 to 10 mm
  return length_m / (length_m + kByRadius * radius_m);
}

}  // namespace teletact::service
