#include "tests/reference/filters.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace teletact::reference {
namespace {

std::size_t index(int i, int j, int nx) {
  return static_cast<std::size_t>(i) + static_cast<std::size_t>(nx) * static_cast<std::size_t>(j);
}

// Mean of the middle two of an even count.
double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return (values[(n - 1) / 2] + values[n / 2]) / 2;
}

// Calls visit(index) for the nodes within `radius` of (i, j) inside the grid.
template <class Visit>
void around(int nx, int ny, int i, int j, int radius, Visit&& visit) {
  for (int n = j - radius; n <= j + radius; ++n)
    for (int m = i - radius; m <= i + radius; ++m)
      if (m >= 0 && m < nx && n >= 0 && n < ny) visit(index(m, n, nx));
}

// Own value and the weighted differences to the pairs of opposite neighbours that are both inside the grid.
double smoothed(const std::vector<double>& v, int nx, int ny, int i, int j) {
  const auto inside = [&](int c, int r) { return c >= 0 && c < nx && r >= 0 && r < ny; };
  const auto at = [&](int c, int r) { return v[index(c, r, nx)]; };
  constexpr int kPairs[4][3] = {{1, 0, 2}, {0, 1, 2}, {1, 1, 1}, {1, -1, 1}};  // offset, weight of 16ths
  double sum = at(i, j);
  for (const auto& [m, n, weight] : kPairs)
    if (inside(i + m, j + n) && inside(i - m, j - n))
      sum += weight * (at(i + m, j + n) - 2 * at(i, j) + at(i - m, j - n)) / 16;
  return sum;
}

}  // namespace

MedianFiltered median_filter(const VectorField& field, const VectorField& prediction,
                             const std::vector<double>& correlation, int radius, double threshold,
                             double lateral_tolerance, double axial_tolerance) {
  MedianFiltered out{field, std::vector<double>(correlation.size())};
  for (std::size_t node = 0; node < correlation.size(); ++node) {
    const int i = static_cast<int>(node) % field.nx, j = static_cast<int>(node) / field.nx;
    std::vector<double> x, y;
    around(field.nx, field.ny, i, j, radius, [&](std::size_t n) {
      if (!(correlation[n] >= threshold)) return;
      x.push_back(field.lateral[n] - prediction.lateral[n]);
      y.push_back(field.axial[n] - prediction.axial[n]);
    });
    if (x.size() < 3) {
      out.field.lateral[node] = prediction.lateral[node];
      out.field.axial[node] = prediction.axial[node];
      out.deviation[node] = std::numeric_limits<double>::infinity();
      continue;
    }
    const double off_x = field.lateral[node] - prediction.lateral[node] - median(x);
    const double off_y = field.axial[node] - prediction.axial[node] - median(y);
    const bool trusted = correlation[node] >= threshold;
    const bool keep_x = trusted && std::abs(off_x) <= lateral_tolerance,
               keep_y = trusted && std::abs(off_y) <= axial_tolerance;
    if (!keep_x) out.field.lateral[node] = prediction.lateral[node] + median(x);
    if (!keep_y) out.field.axial[node] = prediction.axial[node] + median(y);
    out.deviation[node] = keep_x && keep_y ? 0 : std::abs(off_y);
  }
  return out;
}

VectorField smooth(const VectorField& field) {
  VectorField out = field;
  for (int j = 0; j < field.ny; ++j)
    for (int i = 0; i < field.nx; ++i) {
      const auto node = index(i, j, field.nx);
      out.lateral[node] = smoothed(field.lateral, field.nx, field.ny, i, j);
      out.axial[node] = smoothed(field.axial, field.nx, field.ny, i, j);
    }
  return out;
}

double bilinear(const std::vector<double>& values, int nx, int ny, double column, double row) {
  const double c = std::clamp(column, 0.0, nx - 1.0), r = std::clamp(row, 0.0, ny - 1.0);
  double sum = 0;
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {  // hat functions
      const double weight = std::max(0.0, 1 - std::abs(c - i)) * std::max(0.0, 1 - std::abs(r - j));
      sum += weight * values[index(i, j, nx)];
    }
  return sum;
}

std::vector<double> reference_stress(int nx, const std::vector<double>& axial_strain,
                                     const std::vector<std::uint8_t>& trusted,
                                     const std::vector<double>& stress, double amplitude, double scale,
                                     const ReferenceStressLimits& limits) {
  std::vector<double> modulus(axial_strain.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t n = 0; n < modulus.size(); ++n) {
    const double ratio = amplitude * stress[n] / axial_strain[n];
    const bool near_field = static_cast<int>(n) / nx < limits.first_row;
    if (!trusted[n] || near_field || !(std::abs(axial_strain[n]) >= limits.min_strain)) continue;
    if (ratio >= 1 / limits.range && ratio <= limits.range) modulus[n] = scale * ratio;
  }
  return modulus;
}

std::vector<double> modulus_median(int nx, int ny, const std::vector<double>& modulus, int radius) {
  std::vector<double> out(modulus.size(), std::numeric_limits<double>::quiet_NaN());
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      const auto node = index(i, j, nx);
      std::vector<double> said;
      std::size_t inside = 0;
      around(nx, ny, i, j, radius, [&](std::size_t n) {
        ++inside;
        if (!std::isnan(modulus[n])) said.push_back(modulus[n]);
      });
      if (!std::isnan(modulus[node]) && 3 * said.size() >= inside) out[node] = median(said);
    }
  return out;
}

}  // namespace teletact::reference
