#include "service/imaging/modulus/window_nodes.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "service/device/cancellation.h"
#include "service/tissue/elasticity.h"

namespace teletact::service {
namespace {

// Part of a whole neighbourhood's weight that must be there and trusted: a fit to one side alone, at the
// border of the image, is three times as noisy and biased by the near field.
constexpr double kMinMeasured = 0.6;

struct Span {
  std::ptrdiff_t first, last;
};

// Image nodes within `reach` of `at`, in units of the spacing from the first.
Span span(double at, double reach, double origin, double step, std::size_t count) {
  const auto last = static_cast<std::ptrdiff_t>(count) - 1;
  const auto low = static_cast<std::ptrdiff_t>(std::ceil((at - reach - origin) / step));
  const auto high = static_cast<std::ptrdiff_t>(std::floor((at + reach - origin) / step));
  return {std::max<std::ptrdiff_t>(low, 0), std::min(high, last)};
}

// Normal equations of u ~ a + b X + c Y around one node, X and Y in units of the reach.
struct PlaneFit {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d load = Eigen::Vector3d::Zero();
  double weight = 0;
  void add(double x, double y, double weight_of_it, double u) {
    const Eigen::Vector3d f(1, x, y);
    normal += weight_of_it * f * f.transpose();
    load += weight_of_it * u * f;
    weight += weight_of_it;
  }
};

}  // namespace

WindowNodes::WindowNodes(const StripModel& model)
    : nx(model.last_column() - model.first_column() + 1), ny(model.grid().ny()) {
  const TissueGrid& g = model.grid();
  dx_m = (g.x_m[model.last_column()] - g.x_m[model.first_column()]) / static_cast<double>(nx - 1);
  dy_m = g.y_m[1] - g.y_m[0];
}

Field WindowNodes::on_image(const std::vector<double>& values, const ImageGrid& image) const {
  Field out(image.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t n = 0; n < image.size(); ++n) {
    if (n % image.nx == 0) check_cancelled();
    const double x = image.x_m(n) / dx_m;
    const double y = image.y_m(n) / dy_m;
    if (y > static_cast<double>(ny - 1)) continue;
    const auto i = std::min(static_cast<std::size_t>(std::max(x, 0.0)), nx - 2);
    const auto j = std::min(static_cast<std::size_t>(std::max(y, 0.0)), ny - 2);
    const double s = std::clamp(x - static_cast<double>(i), 0.0, 1.0), t = y - static_cast<double>(j);
    const double* upper = &values[i + nx * j];
    out[n] = static_cast<float>((1 - t) * ((1 - s) * upper[0] + s * upper[1]) +
                                t * ((1 - s) * upper[nx] + s * upper[nx + 1]));
  }
  return out;
}

AxialSlopes axial_slopes(const WindowNodes& nodes, const Measured& measured) {
  const ImageGrid& image = measured.grid;
  const Field& axial_m = measured.axial_displacement;
  AxialSlopes out{std::vector<double>(nodes.size()), std::vector<double>(nodes.size()),
                  std::vector<std::uint8_t>(nodes.size(), 0)};
  const double whole = kSlopeReachXM * kSlopeReachYM / (image.dx_m * image.dy_m);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const std::size_t row = n / nodes.nx;
    if (n % nodes.nx == 0) check_cancelled();
    const double x = static_cast<double>(n % nodes.nx) * nodes.dx_m,
                 y = static_cast<double>(row) * nodes.dy_m;
    const Span columns = span(x, kSlopeReachXM, image.origin_x_m, image.dx_m, image.nx),
               rows = span(y, kSlopeReachYM, image.origin_y_m, image.dy_m, image.ny);
    if (columns.last < columns.first || rows.last < rows.first) continue;
    PlaneFit fit;
    const auto at = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
      return static_cast<std::size_t>(i) + image.nx * static_cast<std::size_t>(j);
    };
    const double origin = axial_m[at(columns.first, rows.first)];  // differences keep digits
    for (std::ptrdiff_t j = rows.first; j <= rows.last; ++j)
      for (std::ptrdiff_t i = columns.first; i <= columns.last; ++i) {
        const double dx = (image.origin_x_m + static_cast<double>(i) * image.dx_m - x) / kSlopeReachXM,
                     dy = (image.origin_y_m + static_cast<double>(j) * image.dy_m - y) / kSlopeReachYM;
        const double weight = (1 - std::abs(dx)) * (1 - std::abs(dy));
        if (measured.displacement_valid[at(i, j)]) fit.add(dx, dy, weight, axial_m[at(i, j)] - origin);
      }
    if (!(fit.weight >= kMinMeasured * whole)) continue;
    Eigen::Matrix3d inverse;
    bool invertible = false;
    fit.normal.computeInverseWithCheck(inverse, invertible, 1e-6 * std::pow(fit.weight, 3));
    if (!invertible) continue;
    const Eigen::Vector3d slopes = inverse * fit.load;
    out.across[n] = slopes[1] / kSlopeReachXM;
    out.along[n] = slopes[2] / kSlopeReachYM;
    out.measured[n] = 1;
  }
  return out;
}

ModelState model_state(const StripModel& model, const StripResponse& response,
                       const std::vector<double>& youngs_modulus_pa) {
  const TissueGrid& g = model.grid();
  const WindowNodes nodes(model);
  const double lambda_per_e = model.modulus_factor() * lame_ratios(model.poisson_ratio()).lambda_per_e;
  ModelState out;
  for (auto* field : {&out.along, &out.across, &out.lateral, &out.shear, &out.pressure, &out.log_modulus})
    field->assign(nodes.size(), 0.0);
  std::vector<double> count(nodes.size(), 0.0);
  const std::size_t begin = model.first_column() > 0 ? model.first_column() - 1 : 0;
  const std::size_t end = std::min(model.last_column() + 1, g.nx() - 1);
  for (std::size_t j = 0; j + 1 < g.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = begin; i < end; ++i) {
      const double* upper = &response.displacement[2 * g.node(i, j)];
      const double* lower = &response.displacement[2 * g.node(i, j + 1)];
      const double width = g.x_m[i + 1] - g.x_m[i], height = g.y_m[j + 1] - g.y_m[j];
      const auto across = [&](int c) {
        return (upper[2 + c] + lower[2 + c] - upper[c] - lower[c]) / (2 * width);
      };
      const auto along = [&](int c) {
        return (lower[c] + lower[2 + c] - upper[c] - upper[2 + c]) / (2 * height);
      };
      const double modulus = youngs_modulus_pa[g.element(i, j)];
      for (std::size_t b = 0; b < 2; ++b)
        for (std::size_t a = 0; a < 2; ++a) {
          if (i + a < model.first_column() || i + a > model.last_column()) continue;
          const std::size_t n = i + a - model.first_column() + nodes.nx * (j + b);
          out.along[n] += along(1);
          out.across[n] += across(1);
          out.lateral[n] += across(0);
          out.shear[n] += 0.5 * (along(0) + across(1));
          out.pressure[n] -= lambda_per_e * modulus * (across(0) + along(1));
          out.log_modulus[n] += std::log(modulus);
          ++count[n];
        }
    }
  }
  for (auto* field : {&out.along, &out.across, &out.lateral, &out.shear, &out.pressure, &out.log_modulus})
    for (std::size_t n = 0; n < nodes.size(); ++n) (*field)[n] /= count[n];
  return out;
}

}  // namespace teletact::service
