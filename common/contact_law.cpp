#include "common/contact_law.h"

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

// Of one column, by s.
struct Column {
  Curve w, by_x, by_z, by_xz;
  bool beyond = false;
};

Column straight(const LawSample& sample, double off) {
  return {{sample.log_energy + off * sample.by_log_depth, sample.by_log_depth},
          {sample.by_x_1_m + off * sample.mixed_1_m, sample.mixed_1_m},
          {sample.by_z_1_m + off * sample.by_zs_1_m, sample.by_zs_1_m},
          {sample.by_xz_1_m2 + off * sample.by_xzs_1_m2, sample.by_xzs_1_m2}};
}

Column column_at(const LawColumn& column, double s) {
  const auto end = column.log_depth.begin() + column.rows;
  const auto above = std::upper_bound(column.log_depth.begin(), end, static_cast<float>(s));
  if (above == column.log_depth.begin()) return straight(column.samples[0], s - column.log_depth[0]);
  const std::size_t i = static_cast<std::size_t>(above - column.log_depth.begin()) - 1;
  const double begin = column.log_depth[i];
  if (above == end) {
    Column last = straight(column.samples[i], s - begin);
    last.beyond = s > begin;
    return last;
  }
  const LawSample &a = column.samples[i], &b = column.samples[i + 1];
  const double width = column.log_depth[i + 1] - begin, t = (s - begin) / width;
  return {hermite(a.log_energy, a.by_log_depth, b.log_energy, b.by_log_depth, width, t),
          hermite(a.by_x_1_m, a.mixed_1_m, b.by_x_1_m, b.mixed_1_m, width, t),
          hermite(a.by_z_1_m, a.by_zs_1_m, b.by_z_1_m, b.by_zs_1_m, width, t),
          hermite(a.by_xz_1_m2, a.by_xzs_1_m2, b.by_xz_1_m2, b.by_xzs_1_m2, width, t)};
}

// W and its derivatives at a place.
struct Point {
  double w = 0, by_x = 0, by_s = 0, by_z = 0, by_xz = 0, by_zs = 0;
};

// Between two columns of a lane.
Point between(const Column& a, const Column& b, double width, double t) {
  const Curve w = hermite(a.w.value, a.by_x.value, b.w.value, b.by_x.value, width, t);
  const Curve by_s = hermite(a.w.slope, a.by_x.slope, b.w.slope, b.by_x.slope, width, t);
  const Curve by_z = hermite(a.by_z.value, a.by_xz.value, b.by_z.value, b.by_xz.value, width, t);
  const Curve by_zs = hermite(a.by_z.slope, a.by_xz.slope, b.by_z.slope, b.by_xz.slope, width, t);
  return {w.value, w.slope, by_s.value, by_z.value, by_z.slope, by_zs.value};
}

// Between two lanes.
Point between(const Point& a, const Point& b, double width, double t) {
  const Curve w = hermite(a.w, a.by_z, b.w, b.by_z, width, t);
  const Curve by_x = hermite(a.by_x, a.by_xz, b.by_x, b.by_xz, width, t);
  const Curve by_s = hermite(a.by_s, a.by_zs, b.by_s, b.by_zs, width, t);
  return {w.value, by_x.value, by_s.value, w.slope, by_x.slope, by_s.slope};
}

// One column alone, carried on to a place so far from it.
Point carried(const Column& column, double x_m, double z_m) {
  return {column.w.value + x_m * column.by_x.value + z_m * column.by_z.value,
          column.by_x.value,
          column.w.slope + x_m * column.by_x.slope + z_m * column.by_z.slope,
          column.by_z.value,
          0,
          0};
}

void set_energy(const Point& at, double d, LawValue& value) {
  value.energy_j = std::exp(at.w);
  value.by_x_n = value.energy_j * at.by_x;
  value.by_d_n = value.energy_j * at.by_s / d;
  value.by_z_n = value.energy_j * at.by_z;
}

double force_between_n(const LawValue& a, const LawValue& b) {
  return std::hypot(a.by_x_n - b.by_x_n, a.by_d_n - b.by_d_n, a.by_z_n - b.by_z_n);
}

// The columns of one lane, from begin to before end, around x: the left one of them, and whether there is
// one.
bool left_of(std::span<const LawColumn> columns, std::size_t begin, std::size_t end, double x_m,
             std::size_t& left) {
  if (end - begin < 2 || !(x_m >= columns[begin].x_m && x_m <= columns[end - 1].x_m)) return false;
  const auto first = columns.begin() + static_cast<std::ptrdiff_t>(begin);
  const auto right = std::upper_bound(first + 1, columns.begin() + static_cast<std::ptrdiff_t>(end) - 1, x_m,
                                      [](double x, const LawColumn& column) { return x < column.x_m; });
  left = static_cast<std::size_t>(right - columns.begin()) - 1;
  return right->joined;
}

// The first column of a lane at z or beyond, or strictly beyond.
std::size_t lane_from(std::span<const LawColumn> columns, double z_m, bool beyond) {
  const auto before = [&](const LawColumn& column) { return beyond ? column.z_m <= z_m : column.z_m < z_m; };
  return static_cast<std::size_t>(std::partition_point(columns.begin(), columns.end(), before) -
                                  columns.begin());
}

}  // namespace

LawCell cell_at(std::span<const LawColumn> columns, double x_m, double z_m) noexcept {
  LawCell cell;
  if (columns.empty()) return cell;
  std::size_t left = 0;
  const bool one_lane = columns.front().z_m == columns.back().z_m;
  if (!columns.front().of_area) {
    if (one_lane && left_of(columns, 0, columns.size(), x_m, left)) cell = {{left, left + 1, 0, 0}, 2};
    return cell;
  }
  if (one_lane || !(z_m >= columns.front().z_m && z_m <= columns.back().z_m)) return cell;
  std::size_t after = lane_from(columns, z_m, true);
  if (after == columns.size()) after = lane_from(columns, z_m, false);  // on the last lane
  const std::size_t end = lane_from(columns, columns[after].z_m, true);
  const std::size_t begin = lane_from(columns, columns[after - 1].z_m, false);
  std::size_t left_after = 0;
  if (!left_of(columns, begin, after, x_m, left) || !left_of(columns, after, end, x_m, left_after))
    return cell;
  for (const std::size_t i : {left_after, left_after + 1})
    if (columns[i].lane_before_m != columns[left].z_m) return cell;
  return {{left, left + 1, left_after, left_after + 1}, 4};
}

LawValue evaluate(std::span<const LawColumn> columns, double x_m, double indentation_m, double z_m) noexcept {
  LawValue value;
  const LawCell cell = cell_at(columns, x_m, z_m);
  if (cell.count == 0) return value;
  const auto column = [&](std::size_t i) -> const LawColumn& { return columns[cell.columns[i]]; };
  value.covered = value.corrected = true;
  bool meets_guess = false;  // columns that are corrected, and others
  value.oldest = value.newest = column(0).version;
  for (std::size_t i = 0; i < cell.count; ++i) {
    value.oldest = std::min(value.oldest, column(i).version);
    value.newest = std::max(value.newest, column(i).version);
    value.corrected = value.corrected && column(i).corrected;
    meets_guess = meets_guess || column(i).corrected != column(0).corrected;
  }
  if (!(indentation_m > 0)) return value;
  const double s = std::log(indentation_m);
  std::array<Column, 4> at;
  float share = 0, error_n = 0;
  for (std::size_t i = 0; i < cell.count; ++i) {
    at[i] = column_at(column(i), s);
    value.beyond = value.beyond || at[i].beyond;
    share = std::max(share, column(i).error_share);
    error_n = std::max(error_n, column(i).error_n);
  }
  const auto in_lane = [&](std::size_t i) {
    const double width = column(i + 1).x_m - column(i).x_m;
    return between(at[i], at[i + 1], width, (x_m - column(i).x_m) / width);
  };
  Point point = in_lane(0);
  if (cell.count == 4) {
    const double width = column(2).z_m - column(0).z_m;
    point = between(point, in_lane(2), width, (z_m - column(0).z_m) / width);
  }
  set_energy(point, indentation_m, value);
  value.error_n = share * std::hypot(value.by_x_n, value.by_d_n, value.by_z_n) + error_n;
  if (value.oldest != value.newest || meets_guess) {
    for (std::size_t i = 0; i < cell.count; ++i) {
      LawValue alone;
      set_energy(carried(at[i], x_m - column(i).x_m, cell.count == 4 ? z_m - column(i).z_m : 0),
                 indentation_m, alone);
      value.disagreement_n = std::max(value.disagreement_n, force_between_n(value, alone));
    }
    value.error_n += value.disagreement_n;
  }
  // What no tissue has may overflow: then it covers nothing.
  const double all = value.energy_j + value.by_x_n + value.by_d_n + value.by_z_n + value.error_n;
  return std::isfinite(all) ? value : LawValue{};
}

bool usable(const LawColumn& column) noexcept {
  if (!(column.error_share >= 0 && column.error_share <= 1 && column.error_n >= 0)) return false;
  if (!std::isfinite(column.x_m) || !std::isfinite(column.z_m) || !(column.lane_before_m <= column.z_m) ||
      !std::isfinite(column.lane_before_m) || !std::isfinite(column.error_n) || column.rows == 0 ||
      column.rows > LawColumn::kMaxRows)
    return false;
  for (std::size_t i = 0; i < column.rows; ++i) {
    const LawSample& sample = column.samples[i];
    for (const float number :
         {sample.log_energy, sample.by_x_1_m, sample.by_log_depth, sample.mixed_1_m, sample.by_z_1_m,
          sample.by_zs_1_m, sample.by_xz_1_m2, sample.by_xzs_1_m2, column.log_depth[i]})
      if (!std::isfinite(number)) return false;
    if (!(sample.by_log_depth > 0)) return false;
    if (i > 0 && !(column.log_depth[i] > column.log_depth[i - 1] &&
                   sample.log_energy > column.samples[i - 1].log_energy))
      return false;
  }
  return true;
}

}  // namespace teletact
