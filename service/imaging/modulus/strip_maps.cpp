// Modulus maps on the elements of the strip: what the window's map says, and what is known beside it.
#include <algorithm>
#include <cmath>
#include <limits>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kSampleM = 1e-3, kMirrorM = 0.020;
constexpr int kMatchCells = 4;  // on each side of a border
constexpr double kEdgeSlackM = 1e-6;
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Cells without a value take the mean of those beside them that have one, from the rim inwards.
void spread(std::vector<double>& values, std::vector<int>& counts, std::size_t nx, std::size_t ny) {
  for (bool missing = true, found = true; missing && found;) {
    missing = found = false;
    check_cancelled();
    const std::vector<int> before = counts;
    for (std::size_t n = 0; n < nx * ny; ++n) {
      if (before[n]) continue;
      const std::size_t i = n % nx, j = n / nx;
      double sum = 0;
      int beside = 0;
      const auto add = [&](std::size_t m) {
        if (before[m]) sum += values[m], ++beside;
      };
      if (i > 0) add(n - 1);
      if (i + 1 < nx) add(n + 1);
      if (j > 0) add(n - nx);
      if (j + 1 < ny) add(n + nx);
      missing = true;
      if (!beside) continue;
      found = true;
      values[n] = sum / beside;
      counts[n] = 1;
    }
  }
}

struct Position {
  std::size_t cell;
  double fraction;  // towards cell + 1
};

// Between the centres of the intervals of `coordinates`, held outside the first and last centre.
Position between_centres(const std::vector<double>& coordinates, double at) {
  const auto cells = static_cast<std::ptrdiff_t>(coordinates.size()) - 1;
  const auto centre = [&](std::size_t c) { return 0.5 * (coordinates[c] + coordinates[c + 1]); };
  const auto upper = std::upper_bound(coordinates.begin(), coordinates.end(), at) - coordinates.begin();
  auto c = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(upper - 1, 0, cells - 1));
  if (at < centre(c) && c > 0) --c;
  if (c + 1 >= static_cast<std::size_t>(cells)) return {c - 1, 1.0};
  return {c, std::clamp((at - centre(c)) / (centre(c + 1) - centre(c)), 0.0, 1.0)};
}

}  // namespace

Field StripModel::on_image(const std::vector<double>& element_values, const ImageGrid& image) const {
  Field field(image.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t j = 0; j < image.ny; ++j) {
    check_cancelled();
    const double y = image.origin_y_m + static_cast<double>(j) * image.dy_m;
    if (y > grid_.y_m.back()) continue;
    const Position v = between_centres(grid_.y_m, y);
    for (std::size_t i = 0; i < image.nx; ++i) {
      const Position h = between_centres(grid_.x_m, image.origin_x_m + static_cast<double>(i) * image.dx_m);
      const auto at = [&](std::size_t a, std::size_t b) {
        return element_values[grid_.element(h.cell + a, v.cell + b)];
      };
      field[i + image.nx * j] =
          static_cast<float>((1 - v.fraction) * ((1 - h.fraction) * at(0, 0) + h.fraction * at(1, 0)) +
                             v.fraction * ((1 - h.fraction) * at(0, 1) + h.fraction * at(1, 1)));
    }
  }
  return field;
}

// The map's logarithm on the elements under the probe.
StripModel::WindowMap StripModel::window_map(const Field& youngs_modulus, const ImageGrid& image) const {
  WindowMap map;
  map.first = cell_of(grid_.x_m, kEdgeSlackM);
  map.last = cell_of(grid_.x_m, window_width_m_ - kEdgeSlackM);
  const std::size_t nx = map.last - map.first + 1, ny = grid_.ny() - 1;
  map.logarithm.assign(nx * ny, 0.0);
  std::vector<int> counts(nx * ny, 0);
  for (std::size_t n = 0; n < image.size(); ++n) {
    if (n % image.nx == 0) check_cancelled();
    const double y = image.y_m(n);
    if (!std::isfinite(youngs_modulus[n]) || y > grid_.y_m.back()) continue;
    const double x = image.x_m(n);
    const std::size_t i = std::clamp(cell_of(grid_.x_m, x), map.first, map.last) - map.first;
    const std::size_t cell = i + nx * cell_of(grid_.y_m, y);
    map.logarithm[cell] += std::log(youngs_modulus[n]);
    ++counts[cell];
  }
  for (std::size_t n = 0; n < counts.size(); ++n) map.logarithm[n] /= std::max(1, counts[n]);
  spread(map.logarithm, counts, nx, ny);
  return map;
}

double StripModel::logarithm_at(const WindowMap& map, double x_m, std::size_t row) const {
  const std::size_t column = std::clamp(cell_of(grid_.x_m, x_m), map.first, map.last) - map.first;
  return map.logarithm[column + (map.last - map.first + 1) * row];
}

std::vector<double> StripModel::on_elements(const Field& youngs_modulus, const ImageGrid& image,
                                            double background, const KnownModulus& known) const {
  const WindowMap map = window_map(youngs_modulus, image);
  const double left = known ? std::exp(matching_shift(known, true, map)) : 1;
  const double right = known ? std::exp(matching_shift(known, false, map)) : 1;
  std::vector<double> out(grid_.elements());
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const double x = 0.5 * (grid_.x_m[i] + grid_.x_m[i + 1]), y = 0.5 * (grid_.y_m[j] + grid_.y_m[j + 1]);
      const bool beside = x < 0 || x > window_width_m_;
      const double stated = beside && known ? known_over_element(known, i, y) : kUnknown;
      const double mirrored = x < 0 ? -x : x > window_width_m_ ? 2 * window_width_m_ - x : x;
      const bool near =
          std::abs(mirrored - x) <= 2 * kMirrorM && mirrored >= 0 && mirrored <= window_width_m_;
      out[grid_.element(i, j)] = std::isfinite(stated) ? stated * (x < 0 ? left : right)
                                 : near                ? std::exp(logarithm_at(map, mirrored, j))
                                                       : background;
    }
  }
  return out;
}

// Geometric mean over the width of an element beside the window, which may be wider than an inclusion there;
// NaN where nothing of it is known.
double StripModel::known_over_element(const KnownModulus& known, std::size_t column, double y_m) const {
  const double begin = grid_.x_m[column], width = grid_.x_m[column + 1] - begin;
  const int samples = static_cast<int>(std::ceil(width / kSampleM));
  double sum = 0;
  int count = 0;
  for (int k = 0; k < samples; ++k) {
    const double stated = known(window_x_m_ + begin + width * (k + 0.5) / samples, y_m);
    if (stated > 0 && std::isfinite(stated)) sum += std::log(stated), ++count;
  }
  return count > 0 ? std::exp(sum / count) : kUnknown;
}

// The modulus that is known beside the window has its own error of scale, a few percent, which the border
// would turn into false stiffness: log of the factor that makes it meet the window's own map at this border,
// the median over depth.
double StripModel::matching_shift(const KnownModulus& known, bool left, const WindowMap& map) const {
  std::vector<double> shifts;
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j)
    for (int k = 0; k < kMatchCells; ++k) {
      const double distance = (k + 0.5) * kSampleM;
      const double outside = left ? -distance : window_width_m_ + distance;
      const double inside = left ? distance : window_width_m_ - distance;
      const double stated = known(window_x_m_ + outside, 0.5 * (grid_.y_m[j] + grid_.y_m[j + 1]));
      if (stated > 0 && std::isfinite(stated))
        shifts.push_back(logarithm_at(map, inside, j) - std::log(stated));
    }
  return median(shifts);
}

}  // namespace teletact::service
