#include "service/imaging/tracking/strain.h"

#include <limits>
#include <utility>
#include <vector>

#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {
namespace {

constexpr float kMinFraction = 0.6f;  // of the kernel's nodes that must be trusted

}  // namespace
StrainEstimator::StrainEstimator(Queue queue, StrainOptions options)
    : queue_(std::move(queue)),
      options_(options),
      kernel_(queue_.kernel("strain", "strain", Precision::kFloat)),
      deviation_(queue_.kernel("strain", "strain_deviation", Precision::kFloat)) {}

StrainEstimate StrainEstimator::estimate(const DisplacementEstimate& displacement, const ImageGrid& grid) {
  StrainEstimate out{queue_.array<float>(4 * grid.size()), queue_.array<std::uint8_t>(grid.size()),
                     queue_.array<float>(3 * grid.size())};
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
  // d u_x / dx, d u_x / dy, d u_y / dx, d u_y / dy
  std::vector<float> tables;
  for (std::size_t c = 0; c < 2; ++c)
    for (const bool along : {true, false}) {
      const double scale = noise.unit_m[c] / (along ? grid.dx_m : grid.dy_m);
      for (const float d : noise.response[c].table(plane_slope(half_columns, half_rows, along)))
        tables.push_back(static_cast<float>(scale * d));
    }
  deviation_(over(grid.size()), displacement.information, out.tensor, queue_.array(tables), out.std,
             static_cast<int>(grid.size()), static_cast<float>(noise.response[0].median()),
             static_cast<float>(noise.response[1].median()));
}

}  // namespace teletact::service
