#include "service/imaging/strain.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace teletact::service {
namespace {

constexpr std::size_t kGroup = 32;  // WORK_GROUP of strain.cl

int half_count(double length_m, double step_m) {
  return std::max(1, static_cast<int>(std::lround(length_m / 2 / step_m)));
}

}  // namespace

StrainEstimator::StrainEstimator(Queue queue, StrainOptions options)
    : queue_(std::move(queue)),
      options_(options),
      kernel_(queue_.kernel("strain", "strain", Precision::kFloat)) {
  const auto& o = options_;
  if (!(o.kernel_axial_m > 0 && o.kernel_axial_m <= 0.05 && o.kernel_lateral_m > 0 &&
        o.kernel_lateral_m <= 0.05))
    throw std::invalid_argument("kernel_axial_m, kernel_lateral_m: must be above 0 and at most 0.05 m");
  if (!(o.least_fraction > 0 && o.least_fraction <= 1))
    throw std::invalid_argument("least_fraction: must be above 0 and at most 1");
  if (!(o.residual_limit_m > 0)) throw std::invalid_argument("residual_limit_m: must be above 0 m");
}

StrainEstimate StrainEstimator::estimate(const DisplacementEstimate& displacement, const ImageGrid& grid) {
  StrainEstimate out{queue_.array<float>(4 * grid.size()), queue_.array<std::uint8_t>(grid.size())};
  kernel_({{grid.size(), 1, 1}, {kGroup, 1, 1}}, displacement.field_m, displacement.trusted, out.tensor,
          out.trusted, static_cast<int>(grid.nx), static_cast<int>(grid.ny), static_cast<float>(grid.dx_m),
          static_cast<float>(grid.dy_m), half_count(options_.kernel_lateral_m, grid.dx_m),
          half_count(options_.kernel_axial_m, grid.dy_m), static_cast<float>(options_.least_fraction),
          static_cast<float>(options_.residual_limit_m));
  return out;
}

}  // namespace teletact::service
