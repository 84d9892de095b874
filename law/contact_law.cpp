#include "law/contact_law.h"

#include <algorithm>
#include <cmath>

namespace teletact {
namespace {

// A function of one variable and its slope.
struct Curve {
  double value = 0, slope = 0;
};

// The cubic with these values and slopes at the ends of [0, width], at share t of it.
Curve hermite(double value_0, double slope_0, double value_1, double slope_1, double width, double t) {
  const double rise = value_1 - value_0;
  const double a = width * slope_0 - rise,
               b = rise - width * slope_1;  // v0 + t rise + t (1 - t) ((1 - t) a + t b)
  const double u = 1 - t, bend = u * a + t * b;
  return {value_0 + t * rise + t * u * bend, (rise + (u - t) * bend + t * u * (b - a)) / width};
}

// W and W_x of one column, by s.
struct Column {
  Curve w, by_x;
  bool beyond = false;
};

Column column_at(const LawColumn& column, double s) {
  const auto end = column.log_depth.begin() + column.rows;
  const auto above = std::upper_bound(column.log_depth.begin(), end, static_cast<float>(s));
  const auto straight = [s](const LawSample& sample, double at) {
    const double off = s - at;
    return Column{{sample.log_energy + off * sample.by_log_depth, sample.by_log_depth},
                  {sample.by_x_1_m + off * sample.mixed_1_m, sample.mixed_1_m}};
  };
  if (above == column.log_depth.begin()) return straight(column.samples[0], column.log_depth[0]);
  const std::size_t i = static_cast<std::size_t>(above - column.log_depth.begin()) - 1;
  if (above == end) {
    Column last = straight(column.samples[i], column.log_depth[i]);
    last.beyond = s > column.log_depth[i];
    return last;
  }
  const LawSample &a = column.samples[i], &b = column.samples[i + 1];
  const double begin = column.log_depth[i], width = column.log_depth[i + 1] - begin, t = (s - begin) / width;
  return {hermite(a.log_energy, a.by_log_depth, b.log_energy, b.by_log_depth, width, t),
          hermite(a.by_x_1_m, a.mixed_1_m, b.by_x_1_m, b.mixed_1_m, width, t)};
}

// The force's size against that of one column alone, carried on to `off_m` from it.
double differs_n(const LawValue& value, const Column& column, double off_m, double d) {
  const double u = std::exp(column.w.value + off_m * column.by_x.value);
  const double by_s = column.w.slope + off_m * column.by_x.slope;
  return std::hypot(value.by_x_n - u * column.by_x.value, value.by_d_n - u * by_s / d);
}

}  // namespace

LawValue evaluate(std::span<const LawColumn> columns, double x_m, double indentation_m) noexcept {
  LawValue value;
  if (columns.size() < 2 || !(x_m >= columns.front().x_m && x_m <= columns.back().x_m)) return value;
  auto right = std::upper_bound(columns.begin() + 1, columns.end() - 1, x_m,
                                [](double x, const LawColumn& column) { return x < column.x_m; });
  if (!right->joined) return value;
  value.covered = true;
  const auto left = right - 1;
  value.oldest = std::min(left->version, right->version);
  value.newest = std::max(left->version, right->version);
  if (!(indentation_m > 0)) return value;
  const double s = std::log(indentation_m);
  const Column a = column_at(*left, s), b = column_at(*right, s);
  value.beyond = a.beyond || b.beyond;
  const double width = right->x_m - left->x_m, t = (x_m - left->x_m) / width;
  const Curve w = hermite(a.w.value, a.by_x.value, b.w.value, b.by_x.value, width, t);
  const Curve by_s = hermite(a.w.slope, a.by_x.slope, b.w.slope, b.by_x.slope, width, t);
  const double u = std::exp(w.value), d = indentation_m;
  value.energy_j = u;
  value.by_x_n = u * w.slope;
  value.by_d_n = u * by_s.value / d;
  value.error_n = std::max(left->error_share, right->error_share) * std::hypot(value.by_x_n, value.by_d_n) +
                  std::max(left->error_n, right->error_n);
  if (value.oldest != value.newest) {
    value.disagreement_n =
        std::max(differs_n(value, a, x_m - left->x_m, d), differs_n(value, b, x_m - right->x_m, d));
    value.error_n += value.disagreement_n;
  }
  // What no tissue has may overflow: then it covers nothing.
  const double all = value.energy_j + value.by_x_n + value.by_d_n + value.error_n;
  return std::isfinite(all) ? value : LawValue{};
}

bool usable(const LawColumn& column) noexcept {
  if (!(column.error_share >= 0 && column.error_share <= 1 && column.error_n >= 0)) return false;
  if (!std::isfinite(column.x_m) || !std::isfinite(column.error_n) || column.rows == 0 ||
      column.rows > LawColumn::kMostRows)
    return false;
  for (std::size_t i = 0; i < column.rows; ++i) {
    const LawSample& sample = column.samples[i];
    if (!std::isfinite(sample.log_energy) || !std::isfinite(sample.by_x_1_m) ||
        !std::isfinite(sample.mixed_1_m) || !std::isfinite(column.log_depth[i]) ||
        !(sample.by_log_depth > 0 && std::isfinite(sample.by_log_depth)))
      return false;
    if (i > 0 && !(column.log_depth[i] > column.log_depth[i - 1] &&
                   sample.log_energy > column.samples[i - 1].log_energy))
      return false;
  }
  return true;
}

}  // namespace teletact
