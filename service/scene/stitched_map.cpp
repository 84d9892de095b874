#include "service/scene/stitched_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

constexpr float kNotKnown = std::numeric_limits<float>::quiet_NaN();

struct Span {
  std::size_t begin = 0, end = 0;  // [begin, end)
  std::size_t size() const { return end - begin; }
};

// Image nodes along one axis that lie in [from, to); the nearest one when none does.
Span nodes_within(double from_m, double to_m, double origin_m, double spacing_m, std::size_t count) {
  const double last = static_cast<double>(count - 1);
  const double first_index = std::ceil((from_m - origin_m) / spacing_m - 1e-9);
  const double end_index = std::ceil((to_m - origin_m) / spacing_m - 1e-9);
  const auto clip = [last](double index) { return static_cast<std::size_t>(std::clamp(index, 0.0, last)); };
  if (end_index > first_index && first_index <= last && end_index > 0)
    return {clip(first_index), clip(end_index - 1) + 1};
  const std::size_t nearest = clip(std::round((0.5 * (from_m + to_m) - origin_m) / spacing_m));
  return {nearest, nearest + 1};
}

bool usable(float modulus_pa, std::uint8_t valid) {
  return valid != 0 && std::isfinite(modulus_pa) && modulus_pa > 0;
}

// 0 of none.
double median_of(std::vector<float> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_modulus_pa(const WindowEstimate& w) {
  std::vector<float> values;
  for (std::size_t n = 0; n < w.youngs_modulus_pa.size(); ++n)
    if (usable(w.youngs_modulus_pa[n], w.valid[n])) values.push_back(w.youngs_modulus_pa[n]);
  return median_of(std::move(values));
}

// Harmonic mean of the usable image nodes in a cell, 0 when fewer than half of them are.
float cell_modulus_pa(const WindowEstimate& w, Span columns, Span rows, double median_pa) {
  double inverse_sum = 0;
  std::size_t used = 0;
  for (std::size_t j = rows.begin; j < rows.end; ++j)
    for (std::size_t i = columns.begin; i < columns.end; ++i) {
      const std::size_t n = i + w.grid.nx * j;
      const float modulus_pa = w.youngs_modulus_pa[n];
      if (!usable(modulus_pa, w.valid[n]) || modulus_pa > median_pa * StitchedMap::kLargestContrast ||
          modulus_pa < median_pa / StitchedMap::kLargestContrast)
        continue;
      inverse_sum += 1 / static_cast<double>(modulus_pa);
      ++used;
    }
  return 2 * used >= columns.size() * rows.size() && used > 0 ? static_cast<float>(used / inverse_sum) : 0.0F;
}

// Fills the zeros of an nx x ny patch: each pass gives every empty cell next to known ones the mean of their
// log E, so that passes grow outwards by one cell. Only cells at the border of what is known are looked at.
void extend_in_log(std::vector<float>& modulus_pa, std::size_t nx, std::size_t ny) {
  const auto at_neighbours = [nx, ny](std::size_t n, const auto& each) {
    const std::size_t i = n % nx, j = n / nx;
    if (i > 0) each(n - 1);
    if (i + 1 < nx) each(n + 1);
    if (j > 0) each(n - nx);
    if (j + 1 < ny) each(n + nx);
  };
  std::vector<std::uint8_t> reached(modulus_pa.size());  // known, or at the border of this pass
  for (std::size_t n = 0; n < modulus_pa.size(); ++n) reached[n] = modulus_pa[n] != 0;
  std::vector<std::size_t> last, border;
  for (std::size_t n = 0; n < modulus_pa.size(); ++n)
    if (modulus_pa[n] != 0) last.push_back(n);
  if (last.empty()) throw std::logic_error("extend_in_log: no cell has a known modulus");
  for (; !last.empty(); last.swap(border)) {
    border.clear();
    for (const std::size_t n : last)
      at_neighbours(n, [&](std::size_t neighbour) {
        if (!std::exchange(reached[neighbour], std::uint8_t{1})) border.push_back(neighbour);
      });
    std::vector<float> grown;
    for (const std::size_t n : border) {
      double log_sum = 0;
      int known = 0;
      at_neighbours(n, [&](std::size_t neighbour) {
        if (modulus_pa[neighbour] == 0) return;
        log_sum += std::log(static_cast<double>(modulus_pa[neighbour]));
        ++known;
      });
      grown.push_back(static_cast<float>(std::exp(log_sum / known)));
    }
    for (std::size_t k = 0; k < border.size(); ++k) modulus_pa[border[k]] = grown[k];
  }
}

void check_sizes(const WindowEstimate& w) {
  const ImageGrid& g = w.grid;
  if (g.nx < 1 || g.ny < 1 || !(g.dx_m > 0) || !(g.dy_m > 0))
    throw std::invalid_argument("window.grid: needs at least one node and a positive spacing");
  if (w.youngs_modulus_pa.size() != g.size() || w.valid.size() != g.size() ||
      (!w.log_deviation.empty() && w.log_deviation.size() != g.size()))
    throw std::invalid_argument(
        fmt::format("window.youngs_modulus_pa: {} values and {} flags for {} image nodes",
                    w.youngs_modulus_pa.size(), w.valid.size(), g.size()));
}

std::size_t cells_over(double length_m) {
  return std::max<std::size_t>(1, static_cast<std::size_t>(std::llround(length_m / StitchedMap::kCellM)));
}

}  // namespace

StitchedMap::StitchedMap(const SceneGeometry& geometry, const MemoryAccount& account)
    : nx_(cells_over(geometry.width_m)),
      ny_(cells_over(geometry.depth_m)),
      cell_x_m_(geometry.width_m / static_cast<double>(nx_)),
      cell_y_m_(geometry.depth_m / static_cast<double>(ny_)),
      cells_(nx_, ny_, account) {
  index_columns();
}

std::size_t StitchedMap::column(double x_m) const {
  return static_cast<std::size_t>(std::clamp(x_m / cell_x_m_, 0.0, static_cast<double>(nx_ - 1)));
}

std::size_t StitchedMap::row(double y_m) const {
  return static_cast<std::size_t>(std::clamp(y_m / cell_y_m_, 0.0, static_cast<double>(ny_ - 1)));
}

void StitchedMap::paste(const WindowEstimate& w) {
  check_sizes(w);
  // Columns whose centre the window covers.
  const auto centre_index = [this](double x_m) {
    return static_cast<std::size_t>(
        std::clamp(std::ceil(x_m / cell_x_m_ - 0.5 - 1e-9), 0.0, static_cast<double>(nx_)));
  };
  const std::size_t begin = centre_index(w.window_x_m), end = centre_index(w.window_x_m + w.width_m);
  if (end <= begin) throw std::invalid_argument("window.window_x_m: the window covers nothing of the tissue");
  const std::size_t columns = end - begin;
  const std::vector<float> measured = resample(w, begin, columns);
  std::vector<float> extended = measured;
  extend_in_log(extended, columns, ny_);
  cells_.make_writable(begin, end);
  for (std::size_t j = 0; j < ny_; ++j)
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t from = i - begin + columns * j;
      cells_.set(i, j,
                 {extended[from], measured[from] > 0 ? CellState::kMeasured : CellState::kExtended,
                  deviation_of(w, i, j)});
    }
  index_columns();
}

// Of a cell: that of the image node nearest to its centre.
float StitchedMap::deviation_of(const WindowEstimate& w, std::size_t i, std::size_t j) const {
  if (w.log_deviation.empty()) return kNotKnown;
  const auto nearest = [](double at_m, double origin_m, double step_m, std::size_t count) {
    return static_cast<std::size_t>(
        std::clamp(std::round((at_m - origin_m) / step_m), 0.0, static_cast<double>(count - 1)));
  };
  const double x_m = cell_x_m_ * (static_cast<double>(i) + 0.5) - w.window_x_m,
               y_m = cell_y_m_ * (static_cast<double>(j) + 0.5);
  return w.log_deviation[nearest(x_m, w.grid.origin_x_m, w.grid.dx_m, w.grid.nx) +
                         w.grid.nx * nearest(y_m, w.grid.origin_y_m, w.grid.dy_m, w.grid.ny)];
}

std::vector<float> StitchedMap::resample(const WindowEstimate& w, std::size_t first,
                                         std::size_t columns) const {
  const double median_pa = median_modulus_pa(w);
  const double image_end_m = w.grid.origin_y_m + w.grid.dy_m * static_cast<double>(w.grid.ny - 1);
  std::vector<float> cells(columns * ny_, 0.0F);
  std::size_t measured = 0, in_image = 0;
  for (std::size_t j = 0; j < ny_; ++j) {
    const double y_m = cell_y_m_ * static_cast<double>(j);
    if (y_m + cell_y_m_ < w.grid.origin_y_m || y_m > image_end_m) continue;  // above or below the image
    const Span rows = nodes_within(y_m, y_m + cell_y_m_, w.grid.origin_y_m, w.grid.dy_m, w.grid.ny);
    for (std::size_t i = 0; i < columns; ++i) {
      const double x_m = cell_x_m_ * static_cast<double>(first + i) - w.window_x_m;
      const Span nodes = nodes_within(x_m, x_m + cell_x_m_, w.grid.origin_x_m, w.grid.dx_m, w.grid.nx);
      float& cell = cells[i + columns * j];
      cell = cell_modulus_pa(w, nodes, rows, median_pa);
      measured += cell > 0;
      ++in_image;
    }
  }
  if (measured == 0 ||
      static_cast<double>(measured) < choices::kMinMeasuredShare * static_cast<double>(in_image))
    throw Error(
        ErrorKind::kPrecondition,
        fmt::format("only {} of the window's {} cells have a valid modulus (at least {:.0f} % are needed); "
                    "acquire the window again",
                    measured, in_image, 100 * choices::kMinMeasuredShare));
  return cells;
}

void StitchedMap::index_columns() {
  constexpr std::uint32_t kNone = UINT32_MAX;
  std::vector<std::uint32_t> left(nx_, kNone), right(nx_, kNone);
  const auto known = [this](std::size_t i) { return cells_.at(i, 0).state != CellState::kUnknown; };
  const auto nx = static_cast<std::uint32_t>(nx_);
  for (std::uint32_t i = 0; i < nx; ++i) left[i] = known(i) ? i : (i > 0 ? left[i - 1] : kNone);
  for (std::uint32_t i = nx; i-- > 0;) right[i] = known(i) ? i : (i + 1 < nx_ ? right[i + 1] : kNone);
  source_column_.assign(nx_, kNone);
  for (std::size_t i = 0; i < nx_; ++i) {
    const bool take_left = right[i] == kNone || (left[i] != kNone && i - left[i] <= right[i] - i);
    source_column_[i] = take_left ? left[i] : right[i];
  }
}

double StitchedMap::mean_modulus_pa(double x0_m, double x1_m, double y0_m, double y1_m) const {
  double inverse_sum = 0, area = 0;
  for (std::size_t j = row(y0_m); j <= row(y1_m); ++j) {
    const double top_m = cell_y_m_ * static_cast<double>(j);
    const double height = std::min(y1_m, top_m + cell_y_m_) - std::max(y0_m, top_m);
    if (height <= 0) continue;
    for (std::size_t i = column(x0_m); i <= column(x1_m); ++i) {
      const double left_m = cell_x_m_ * static_cast<double>(i);
      const double width = std::min(x1_m, left_m + cell_x_m_) - std::max(x0_m, left_m);
      if (width <= 0) continue;
      if (source_column_[i] >= nx_) throw std::logic_error("mean_modulus_pa: nothing is published yet");
      inverse_sum += width * height / static_cast<double>(cells_.at(source_column_[i], j).modulus_pa);
      area += width * height;
    }
  }
  return area / inverse_sum;
}

std::optional<Cell> StitchedMap::measured_cell(double x_m, double y_m) const {
  const double i = std::floor(x_m / cell_x_m_), j = std::floor(y_m / cell_y_m_);
  const bool inside = i >= 0 && j >= 0 && i < static_cast<double>(nx_) && j < static_cast<double>(ny_);
  if (!inside) return std::nullopt;
  const Cell cell = cells_.at(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
  return cell.state == CellState::kMeasured ? std::optional(cell) : std::nullopt;
}

double StitchedMap::measured_modulus_pa(double x_m, double y_m) const {
  const auto cell = measured_cell(x_m, y_m);
  return cell ? cell->modulus_pa : kNotKnown;
}

double StitchedMap::measured_log_deviation(double x_m, double y_m) const {
  const auto cell = measured_cell(x_m, y_m);
  return cell ? cell->log_deviation : kNotKnown;
}

struct StitchedMap::Box {
  Span columns, rows;
};

StitchedMap::Box StitchedMap::cells_touched(double x0_m, double x1_m, double y0_m, double y1_m) const {
  return {{column(x0_m), column(x1_m) + 1}, {row(y0_m), row(y1_m) + 1}};
}

double StitchedMap::measured_share(double x0_m, double x1_m, double y0_m, double y1_m) const {
  const Box box = cells_touched(x0_m, x1_m, y0_m, y1_m);
  std::size_t measured = 0;
  for (std::size_t j = box.rows.begin; j < box.rows.end; ++j)
    for (std::size_t i = box.columns.begin; i < box.columns.end; ++i)
      measured += cells_.at(i, j).state == CellState::kMeasured;
  return static_cast<double>(measured) / static_cast<double>(box.columns.size() * box.rows.size());
}

StitchedMap::Measured StitchedMap::measured(double x0_m, double x1_m, double y0_m, double y1_m) const {
  const Box box = cells_touched(x0_m, x1_m, y0_m, y1_m);
  std::vector<float> deviations;
  for (std::size_t j = box.rows.begin; j < box.rows.end; ++j)
    for (std::size_t i = box.columns.begin; i < box.columns.end; ++i) {
      const Cell cell = cells_.at(i, j);
      if (cell.state == CellState::kMeasured && std::isfinite(cell.log_deviation))
        deviations.push_back(cell.log_deviation);
    }
  return {measured_share(x0_m, x1_m, y0_m, y1_m), median_of(std::move(deviations))};
}

template <class Value>
auto StitchedMap::each(Value value) const {
  std::vector<decltype(value(Cell()))> values;
  values.reserve(nx_ * ny_);
  for (std::size_t j = 0; j < ny_; ++j)
    for (std::size_t i = 0; i < nx_; ++i) values.push_back(value(cells_.at(i, j)));
  return values;
}

std::vector<float> StitchedMap::youngs_modulus_pa() const {
  return each([](const Cell& cell) { return cell.modulus_pa; });
}

std::vector<CellState> StitchedMap::states() const {
  return each([](const Cell& cell) { return cell.state; });
}

std::vector<float> StitchedMap::log_deviation() const {
  return each([](const Cell& cell) { return cell.log_deviation; });
}

void StitchedMap::restore(const std::vector<float>& youngs_modulus_pa, const std::vector<CellState>& states,
                          const std::vector<float>& log_deviation) {
  const bool deviations = !log_deviation.empty();
  if (youngs_modulus_pa.size() != nx_ * ny_ || states.size() != nx_ * ny_ ||
      (deviations && log_deviation.size() != nx_ * ny_))
    throw std::invalid_argument(
        fmt::format("map: {} cells kept, {} expected", youngs_modulus_pa.size(), nx_ * ny_));
  for (std::size_t n = 0; n < states.size(); ++n) {
    if (states[n] > CellState::kMeasured) throw std::invalid_argument("map: unknown cell state");
    const bool positive = std::isfinite(youngs_modulus_pa[n]) && youngs_modulus_pa[n] > 0;
    if (states[n] != CellState::kUnknown && !positive)
      throw std::invalid_argument(
          fmt::format("map: modulus {} Pa of cell {} is not positive", youngs_modulus_pa[n], n));
    if (deviations && (log_deviation[n] < 0 || std::isinf(log_deviation[n])))
      throw std::invalid_argument(
          fmt::format("map: a deviation of {} of cell {} cannot be", log_deviation[n], n));
  }
  for (std::size_t i = 0; i < nx_; ++i) {
    if (states[i] == CellState::kUnknown) continue;  // a column is published or not
    cells_.make_writable(i, i + 1);
    for (std::size_t j = 0; j < ny_; ++j) {
      const std::size_t n = i + nx_ * j;
      cells_.set(i, j, {youngs_modulus_pa[n], states[n], deviations ? log_deviation[n] : kNotKnown});
    }
  }
  index_columns();
}

KnownModulus known_modulus(const std::shared_ptr<const StitchedMap>& map) {
  if (!map) return {};
  return {[map](double x_m, double y_m) { return map->measured_modulus_pa(x_m, y_m); },
          [map](double x_m, double y_m) { return map->measured_log_deviation(x_m, y_m); }};
}

}  // namespace teletact::service
