#include "service/tissue/grid.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace teletact::service {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw std::invalid_argument(why);
}

void validate_coordinates(const std::vector<double>& coordinates, const char* field) {
  if (coordinates.size() < 2)
    refuse(fmt::format("grid.{}: needs at least 2 lines of nodes, has {}; add lines", field,
                       coordinates.size()));
  for (std::size_t k = 0; k < coordinates.size(); ++k) {
    if (!std::isfinite(coordinates[k]))
      refuse(fmt::format("grid.{}[{}] is not finite; give every coordinate in metres", field, k));
    if (k > 0 && !(coordinates[k] > coordinates[k - 1]))
      refuse(fmt::format(
          "grid.{}[{}] does not exceed the one before it; sort the lines and drop repeated ones", field, k));
  }
}

// Steps that grow from `fine` by `ratio` up to `coarse`, scaled down so that they end exactly at `length`.
std::vector<double> growing_steps(double length, double fine, double coarse, double ratio) {
  std::vector<double> steps;
  double sum = 0, step = fine;
  while (sum < length * (1 - 1e-12)) {
    step = std::min(step * ratio, coarse);
    steps.push_back(step);
    sum += step;
  }
  for (double& s : steps) s *= length / sum;
  return steps;
}

}  // namespace

void require(bool condition, const std::string& message) {
  if (!condition) refuse(message);
}

void validate(const TissueGrid& grid) {
  validate_coordinates(grid.x_m, "x_m");
  validate_coordinates(grid.y_m, "y_m");
  if (grid.y_m.front() != 0)
    refuse(fmt::format("grid.y_m[0] is {}; depth starts at 0, the natural surface", grid.y_m.front()));
}

void validate(const TissueGrid& grid, const Material& material) {
  validate(grid);
  if (!(material.poisson_ratio >= 0 && material.poisson_ratio < 0.5))
    refuse(fmt::format(
        "material.poisson_ratio is {}; give 0 <= nu < 0.5, for nearly incompressible tissue for example "
        "0.49",
        material.poisson_ratio));
  if (material.youngs_modulus_pa.size() != grid.elements())
    refuse(fmt::format("material.youngs_modulus_pa has {} values for {} elements; give one per element",
                       material.youngs_modulus_pa.size(), grid.elements()));
  for (std::size_t e = 0; e < material.youngs_modulus_pa.size(); ++e) {
    const double modulus = material.youngs_modulus_pa[e];
    if (!(std::isfinite(modulus) && modulus > 0))
      refuse(
          fmt::format("material.youngs_modulus_pa[{}] is {}; every element needs a finite modulus above 0 Pa",
                      e, modulus));
  }
}

std::size_t position_among(std::size_t column, ColumnRange range) {
  if (column < range.first || column > range.last) {
    throw std::out_of_range(fmt::format("compliance: column {} is outside the touchable ones, {} to {}",
                                        column, range.first, range.last));
  }
  return column - range.first;
}

std::vector<double> uniform_coordinates(double begin_m, double end_m, std::size_t count) {
  require(std::isfinite(begin_m) && std::isfinite(end_m) && end_m > begin_m,
          "uniform_coordinates: end_m must exceed begin_m");
  require(count >= 1, "uniform_coordinates: count must be at least 1");
  std::vector<double> coordinates(count + 1);
  const double length = end_m - begin_m;
  for (std::size_t k = 0; k <= count; ++k) coordinates[k] = begin_m + length * double(k) / double(count);
  coordinates.back() = end_m;
  return coordinates;
}

std::vector<double> graded_coordinates(double begin_m, double end_m, double fine_begin_m, double fine_end_m,
                                       double fine_m, double coarse_m, double ratio) {
  require(begin_m <= fine_begin_m && fine_begin_m < fine_end_m && fine_end_m <= end_m,
          "graded_coordinates: the fine range must lie inside [begin_m, end_m]");
  require(fine_m > 0 && coarse_m >= fine_m && std::isfinite(coarse_m),
          "graded_coordinates: spacings must be positive, coarse_m not below fine_m");
  require(ratio > 1 && std::isfinite(ratio), "graded_coordinates: ratio must exceed 1");
  std::vector<double> coordinates{begin_m};
  std::vector<double> left = growing_steps(fine_begin_m - begin_m, fine_m, coarse_m, ratio);
  std::reverse(left.begin(), left.end());
  for (double step : left) coordinates.push_back(coordinates.back() + step);
  coordinates.back() = fine_begin_m;  // exact, whatever was rounded on the way
  const double cells = std::max(1.0, std::round((fine_end_m - fine_begin_m) / fine_m));
  const auto fine = uniform_coordinates(fine_begin_m, fine_end_m, std::size_t(cells));
  coordinates.insert(coordinates.end(), fine.begin() + 1, fine.end());
  const std::vector<double> right = growing_steps(end_m - fine_end_m, fine_m, coarse_m, ratio);
  for (double step : right) coordinates.push_back(coordinates.back() + step);
  coordinates.back() = end_m;
  return coordinates;
}

std::size_t cell_of(const std::vector<double>& coordinates, double at) {
  const auto upper = std::upper_bound(coordinates.begin(), coordinates.end(), at) - coordinates.begin();
  return static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(upper - 1, 0, static_cast<std::ptrdiff_t>(coordinates.size()) - 2));
}

}  // namespace teletact::service
