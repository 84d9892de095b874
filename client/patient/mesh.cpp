#include "client/patient/mesh.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

namespace {

constexpr double kPlaneFineDepth = 0.025, kBelowInclusion = 0.002, kPlaneGrowth = 1.15;
constexpr double kMaxBytes = 4e9;  // of the column solver's factor, nx (2 ny)^2 doubles

std::vector<double> row_depths(const Tissue& tissue, double spacing_m) {
  double fine = kPlaneFineDepth;
  for (const Inclusion& i : tissue.inclusions)
    fine = std::max(fine, i.y_m + i.diameter_m / 2 + kBelowInclusion);
  fine = std::min(fine, tissue.depth_m);
  std::size_t count = std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(fine / spacing_m)));
  if (fine == tissue.depth_m) {
    std::vector<double> rows_m(count + 1);
    for (std::size_t k = 0; k <= count; ++k)
      rows_m[k] = tissue.depth_m * static_cast<double>(k) / static_cast<double>(count);
    return rows_m;
  }
  std::vector<double> rows_m;
  for (std::size_t k = 0; k <= count; ++k) rows_m.push_back(spacing_m * static_cast<double>(k));
  for (double step = spacing_m; rows_m.back() < tissue.depth_m;) {
    step = std::min(step * kPlaneGrowth, 2 * spacing_m);
    rows_m.push_back(rows_m.back() + step);
  }
  // Stretch the coarse part so that it ends at the bottom.
  const double begin = rows_m[count], scale = (tissue.depth_m - begin) / (rows_m.back() - begin);
  for (std::size_t k = count + 1; k < rows_m.size(); ++k) rows_m[k] = begin + (rows_m[k] - begin) * scale;
  return rows_m;
}

double mean_modulus(const Tissue& tissue, double x0, double x1, double y0, double y1) {
  constexpr int kPoints = 5;
  double sum = 0;
  for (int b = 0; b < kPoints; ++b)
    for (int a = 0; a < kPoints; ++a)
      sum += tissue.true_modulus(x0 + (x1 - x0) * (a + .5) / kPoints, y0 + (y1 - y0) * (b + .5) / kPoints);
  return sum / (kPoints * kPoints);
}

}  // namespace

PatientMesh make_mesh(const Tissue& tissue, double spacing_m) {
  if (!(spacing_m >= 1e-5)) throw TissueError("spacing_m: must be at least 1e-5");
  PatientMesh mesh;
  mesh.poisson_ratio = tissue.poisson_ratio;
  const auto columns =
      std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(tissue.width_m / spacing_m)));
  for (std::size_t i = 0; i <= columns; ++i)
    mesh.x_m.push_back(tissue.width_m * static_cast<double>(i) / static_cast<double>(columns));
  mesh.y_m = row_depths(tissue, spacing_m);
  if (32 * static_cast<double>(columns) * std::pow(static_cast<double>(mesh.ny()), 2) > kMaxBytes)
    throw TissueError("tissue.width_m, tissue.depth_m: the mesh needs more than 4 GB; reduce them");
  for (std::size_t j = 0; j + 1 < mesh.ny(); ++j)
    for (std::size_t i = 0; i < columns; ++i)
      mesh.youngs_modulus_pa.push_back(
          mean_modulus(tissue, mesh.x_m[i], mesh.x_m[i + 1], mesh.y_m[j], mesh.y_m[j + 1]));
  return mesh;
}

std::array<double, 64> element_stiffness(double dx_m, double dy_m, double poisson_ratio) {
  const double mu = 1 / (2 * (1 + poisson_ratio));
  const double lambda = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  std::array<double, 64> k{};
  // Adds weight (2 mu eps:eps) or weight lambda (div u)^2 at the point (s, t) of the unit square.
  const auto add = [&](double s, double t, double weight, bool volumetric) {
    const std::array<double, 4> gx{-(1 - t) / dx_m, (1 - t) / dx_m, -t / dx_m, t / dx_m};
    const std::array<double, 4> gy{-(1 - s) / dy_m, -s / dy_m, (1 - s) / dy_m, s / dy_m};
    for (std::size_t a = 0; a < 4; ++a)
      for (std::size_t b = 0; b < 4; ++b) {
        double* row = &k[16 * a + 2 * b];
        if (volumetric) {
          row[0] += weight * lambda * gx[a] * gx[b], row[1] += weight * lambda * gx[a] * gy[b];
          row[8] += weight * lambda * gy[a] * gx[b], row[9] += weight * lambda * gy[a] * gy[b];
        } else {  // 2 eps:eps = 2 ux,x vx,x + 2 uy,y vy,y + (ux,y + uy,x)(vx,y + vy,x)
          row[0] += weight * mu * (2 * gx[a] * gx[b] + gy[a] * gy[b]), row[1] += weight * mu * gy[a] * gx[b];
          row[8] += weight * mu * gx[a] * gy[b], row[9] += weight * mu * (2 * gy[a] * gy[b] + gx[a] * gx[b]);
        }
      }
  };
  const double g = .5 / std::sqrt(3.0), area = dx_m * dy_m;
  for (const double t : {.5 - g, .5 + g})
    for (const double s : {.5 - g, .5 + g}) add(s, t, area / 4, false);
  add(.5, .5, area, true);
  return k;
}

PlaneField::PlaneField(const PatientMesh& mesh, std::vector<double> u)
    : x_m_(mesh.x_m), y_m_(mesh.y_m), u_(std::move(u)) {
  if (u_.size() != 2 * x_m_.size() * y_m_.size())
    throw std::invalid_argument("PlaneField: u does not fit the mesh");
}

DisplacementField::Vector PlaneField::at(double x_m, double y_m, double) const {
  const std::size_t nx = x_m_.size(), ny = y_m_.size();
  const double x = std::clamp(x_m, x_m_.front(), x_m_.back()), y = std::clamp(y_m, 0.0, y_m_.back());
  const double across = x / x_m_.back() * static_cast<double>(nx - 1);  // columns are equally spaced
  const std::size_t i = std::min(nx - 2, static_cast<std::size_t>(across));
  const auto above = std::upper_bound(y_m_.begin(), y_m_.end(), y);
  const std::size_t j = std::min<std::size_t>(ny - 2, static_cast<std::size_t>(above - y_m_.begin()) - 1);
  const double s = across - static_cast<double>(i), t = (y - y_m_[j]) / (y_m_[j + 1] - y_m_[j]);
  const double* left = &u_[2 * (j + ny * i)];
  const double* right = left + 2 * ny;
  const auto mix = [&](std::size_t c) {
    return (1 - s) * ((1 - t) * left[c] + t * left[c + 2]) + s * ((1 - t) * right[c] + t * right[c + 2]);
  };
  return {mix(0), mix(1), 0};
}

}  // namespace teletact::client
