#include "service/imaging/tracking/measured.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "service/imaging/tracking/median.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

namespace {

constexpr float kMinFraction = 0.6f;  // of the kernel's nodes that must be trusted

}  // namespace
StrainEstimator::StrainEstimator(Queue queue, StrainOptions options)
    : queue_(std::move(queue)),
      options_(options),
      kernel_(queue_.kernel("strain", "strain", Precision::kFloat)),
      rest_(queue_.kernel("strain", "strain_rest", Precision::kFloat)),
      deviation_(queue_.kernel("strain", "strain_deviation", Precision::kFloat)) {}

StrainEstimate StrainEstimator::estimate(const DisplacementEstimate& displacement, const ImageGrid& grid) {
  StrainEstimate out{queue_.array<float>(4 * grid.size()), queue_.array<std::uint8_t>(grid.size()),
                     queue_.array<float>(4 * grid.size())};
  // Slopes of the least-squares plane over the kernel (T2.4).
  const int half_columns = half_width(options_.kernel_lateral_m, grid.dx_m),
            half_rows = half_width(options_.kernel_axial_m, grid.dy_m);
  kernel_(over(grid.size()), displacement.field_m, displacement.trusted, out.tensor, out.trusted,
          static_cast<int>(grid.nx), static_cast<int>(grid.ny), static_cast<float>(grid.dx_m),
          static_cast<float>(grid.dy_m), half_columns, half_rows, kMinFraction,
          static_cast<float>(options_.residual_limit_m));
  propagate(displacement, grid, half_columns, half_rows, out);
  return out;
}

void StrainEstimator::propagate(const DisplacementEstimate& displacement, const ImageGrid& grid,
                                int half_columns, int half_rows, StrainEstimate& out) {
  if (!displacement.noise) {
    const std::vector<float> unknown(out.std.size(), std::numeric_limits<float>::quiet_NaN());
    return queue_.write(out.std, unknown.data(), unknown.size());
  }
  const NoiseStructure& noise = *displacement.noise;
  // Noise, the noise's part of what strain_rest() sees, and the bias over that; of each d u_x / dx, d u_x /
  // dy, d u_y / dx, d u_y / dy.
  std::vector<float> tables;
  const auto add = [&](bool in_nodes, auto&& table_of) {
    for (std::size_t c = 0; c < 2; ++c)
      for (const bool along : {true, false}) {
        const double scale = in_nodes ? noise.unit_m[c] / (along ? grid.dx_m : grid.dy_m) : 1;
        for (const float d : table_of(noise.response[c], along))
          tables.push_back(static_cast<float>(scale * d));
      }
  };
  add(true, [=](const NoiseResponse& r, bool along) { return r.slope(half_columns, half_rows, along); });
  add(true, [=](const NoiseResponse& r, bool along) { return r.slope_rest(half_columns, half_rows, along); });
  add(false, [=](const NoiseResponse& r, bool along) {
    return r.slope_bias_over_seen(half_columns, half_rows, along);
  });
  const int nx = static_cast<int>(grid.nx), ny = static_cast<int>(grid.ny);
  Array<float> rest = queue_.array<float>(3 * grid.size());
  rest_(over(grid.size()), out.tensor, out.trusted, rest, nx, ny, half_columns, half_rows);
  deviation_(over(grid.size()), displacement.information, out.tensor, rest, sent(queue_, tables), out.std, nx,
             ny, half_columns, half_rows, static_cast<float>(noise.response[0].median()),
             static_cast<float>(noise.response[1].median()));
}

namespace {

constexpr float kUntextured = -1.5f;  // correlations below mean that the window has no texture
constexpr double kMinTexturedFraction = 0.1;

// Takes interleaved components apart: the first of every node to the first field, and so on.
void split(const std::vector<float>& interleaved, std::size_t components, std::initializer_list<Field*> to) {
  std::size_t c = 0;
  for (Field* field : to) {
    field->resize(interleaved.size() / components);
    for (std::size_t n = 0; n < field->size(); ++n) (*field)[n] = interleaved[components * n + c];
    ++c;
  }
}

double pair_quality(const Measured& m) {
  std::vector<float> magnitude, deviation;
  for (std::size_t n = 0; n < m.strain_valid.size(); ++n) {
    if (!m.strain_valid[n] || !std::isfinite(m.axial_strain_noise[n])) continue;
    magnitude.push_back(std::abs(m.axial_strain[n]));
    deviation.push_back(m.axial_strain_noise[n]);
  }
  if (magnitude.empty()) return 0;
  const double e = median(magnitude), s = median(deviation), power = e * e + s * s;
  std::size_t tissue = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n) tissue += m.grid.y_m(n) >= m.coupling_m;
  const double usable = static_cast<double>(magnitude.size()) / static_cast<double>(tissue);
  return power > 0 ? usable * e * e / power : 0;
}

}  // namespace

// Of a download the last read is a blocking one: what was fetched before it is here then too.
void download(const Queue& queue, const DisplacementEstimate& displacement, Measured& out) {
  std::vector<float> field(displacement.field_m.size()), deviation(displacement.std_m.size());
  out.correlation.resize(out.grid.size());
  const std::array<Arrival, 3> fetched{
      queue.fetch(displacement.field_m, field.data(), field.size()),
      queue.fetch(displacement.std_m, deviation.data(), deviation.size()),
      queue.fetch(displacement.correlation, out.correlation.data(), out.correlation.size())};
  out.displacement_valid = queue.read(displacement.trusted);
  split(field, 2, {&out.lateral_displacement, &out.axial_displacement});
  split(deviation, 2, {&out.lateral_displacement_std, &out.axial_displacement_std});
}

void download(const Queue& queue, const StrainEstimate& strain, Measured& out) {
  std::vector<float> tensor(strain.tensor.size()), deviation(strain.std.size());
  const std::array<Arrival, 2> fetched{queue.fetch(strain.tensor, tensor.data(), tensor.size()),
                                       queue.fetch(strain.std, deviation.data(), deviation.size())};
  out.strain_valid = queue.read(strain.trusted);
  split(tensor, 4, {&out.lateral_strain, &out.axial_strain, &out.shear_strain});
  split(deviation, 4,
        {&out.lateral_strain_std, &out.axial_strain_std, &out.shear_strain_std, &out.axial_strain_noise});
  out.quality = pair_quality(out);
}

bool rests_below(double surface_m, const Measured& m) {
  constexpr double kNearM = 4e-3, kMostM = 5e-3;  // near it echoes are weak
  const double from_m = surface_m + kNearM,
               each_m = std::min(kMostM, (m.grid.y_m(m.grid.size() - 1) - from_m) / 2);
  struct Moved {
    double y_m, by_m;
  };
  const auto moved = [&](double first_m) -> std::optional<Moved> {
    std::vector<float> places, values;
    for (std::size_t n = 0; n < m.grid.size(); ++n)
      if (m.displacement_valid[n] && m.grid.y_m(n) >= first_m && m.grid.y_m(n) < first_m + each_m)
        places.push_back(static_cast<float>(m.grid.y_m(n))), values.push_back(m.axial_displacement[n]);
    if (values.empty()) return std::nullopt;
    return Moved{median(places), median(values)};
  };
  const std::optional<Moved> upper = moved(from_m), lower = moved(from_m + each_m);
  if (!upper || !lower) return false;
  return upper->y_m - upper->by_m * (lower->y_m - upper->y_m) / (lower->by_m - upper->by_m) > surface_m / 2;
}

void leave_out_above(double depth_m, Measured& m) {
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.grid.y_m(n) < depth_m) m.displacement_valid[n] = m.strain_valid[n] = 0;
  m.quality = pair_quality(m);
}

double median_correlation(const Field& correlation) {
  std::vector<float> textured;
  std::copy_if(correlation.begin(), correlation.end(), std::back_inserter(textured),
               [](float c) { return c > kUntextured; });
  if (textured.empty() ||
      static_cast<double>(textured.size()) < kMinTexturedFraction * static_cast<double>(correlation.size()))
    throw TrackingError(
        TrackingError::Reason::kNoSignal,
        fmt::format("pre, post: {} of {} nodes show any echo; check the gain and the probe's contact",
                    textured.size(), correlation.size()));
  return median(textured);
}

std::optional<double> lateral_ratio(const Measured& m) {
  std::vector<float> lateral, axial;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.strain_valid[n]) lateral.push_back(m.lateral_strain[n]), axial.push_back(m.axial_strain[n]);
  if (axial.empty()) return std::nullopt;
  return -median(lateral) / median(axial);
}

}  // namespace teletact::service
