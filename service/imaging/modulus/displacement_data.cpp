#include "service/imaging/modulus/displacement_data.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "service/device/cancellation.h"

namespace teletact::service {
namespace {

constexpr std::size_t kDataAtOnce = 512;  // between two looks

// Weighted sums of the straight line through (modelled, displacement).
struct Line {
  double w = 0, x = 0, y = 0, xx = 0, xy = 0;
  void add(double weight, double a, double b) {
    w += weight, x += weight * a, y += weight * b, xx += weight * a * a, xy += weight * a * b;
  }
  double slope() const {
    const double determinant = w * xx - x * x;
    return determinant > 0 ? (w * xy - x * y) / determinant : 0;
  }
  double constant(double slope) const { return w > 0 ? (y - slope * x) / w : 0; }
};

}  // namespace

DisplacementData::DisplacementData(const StripModel& model, const Measured& measured, float min_deviation_m,
                                   double independent_m2)
    : dofs_(model.grid().dofs()),
      independence_(std::min(1.0, measured.grid.dx_m * measured.grid.dy_m / independent_m2)) {
  const TissueGrid& g = model.grid();
  const ImageGrid& image = measured.grid;
  for (std::size_t n = 0; n < image.size(); ++n) {
    if (n % image.nx == 0) check_cancelled();
    const double x = image.x_m(n);
    const double y = image.y_m(n);
    const float deviation_m = std::max(measured.axial_displacement_std[n], min_deviation_m);
    const bool weighs = deviation_m > 0 && std::isfinite(deviation_m);
    if (!measured.displacement_valid[n] || y > g.y_m.back() || !weighs) continue;
    const std::size_t i = cell_of(g.x_m, x), j = cell_of(g.y_m, y);
    const double s = (x - g.x_m[i]) / (g.x_m[i + 1] - g.x_m[i]),
                 t = (y - g.y_m[j]) / (g.y_m[j + 1] - g.y_m[j]);
    data_.push_back({{g.node(i, j), g.node(i + 1, j), g.node(i, j + 1), g.node(i + 1, j + 1)},
                     {static_cast<float>((1 - s) * (1 - t)), static_cast<float>(s * (1 - t)),
                      static_cast<float>((1 - s) * t), static_cast<float>(s * t)},
                     measured.axial_displacement[n],
                     1 / static_cast<double>(deviation_m)});
  }
}

std::vector<double> DisplacementData::observed(const std::vector<double>& displacement) const {
  check_cancelled();
  std::vector<double> out(data_.size());
  for (std::size_t k = 0; k < data_.size(); ++k)
    for (int a = 0; a < 4; ++a) out[k] += data_[k].share[a] * displacement[2 * data_[k].node[a] + 1];
  return out;
}

DisplacementData::Fit DisplacementData::fit(const std::vector<double>& displacement) const {
  Fit out;
  out.modelled = observed(displacement);
  check_cancelled();
  Line line;
  for (std::size_t k = 0; k < data_.size(); ++k)
    line.add(data_[k].weight * data_[k].weight, out.modelled[k], data_[k].displacement_m);
  out.amplitude = line.slope();
  out.offset_m = line.constant(out.amplitude);
  double squares = 0;
  for (std::size_t k = 0; k < data_.size(); ++k) {
    const double r = out.amplitude * out.modelled[k] + out.offset_m - data_[k].displacement_m;
    out.residual.push_back(r * data_[k].weight);
    squares += out.residual.back() * out.residual.back();
  }
  out.misfit = 0.5 * independence_ * squares;
  out.mean_square = squares / static_cast<double>(std::max<std::size_t>(1, data_.size()));
  return out;
}

// Removes what amplitude and offset can follow: the weighted columns `modelled` and 1.
void DisplacementData::project(const Fit& fit, std::vector<double>& weighted) const {
  check_cancelled();
  Line line;
  for (std::size_t k = 0; k < data_.size(); ++k)
    line.add(data_[k].weight * data_[k].weight, fit.modelled[k], weighted[k] / data_[k].weight);
  const double slope = line.slope(), constant = line.constant(slope);
  for (std::size_t k = 0; k < data_.size(); ++k)
    weighted[k] -= data_[k].weight * (slope * fit.modelled[k] + constant);
}

std::vector<double> DisplacementData::change(const Fit& fit, const std::vector<double>& change) const {
  std::vector<double> out = observed(change);
  const double scale = fit.amplitude * std::sqrt(independence_);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] *= scale * data_[k].weight;
  project(fit, out);
  return out;
}

std::vector<double> DisplacementData::transposed(const Fit& fit, const std::vector<double>& residual) const {
  std::vector<double> projected = residual, out(dofs_, 0.0);
  project(fit, projected);
  check_cancelled();
  const double scale = fit.amplitude * std::sqrt(independence_);
  for (std::size_t k = 0; k < projected.size(); ++k)
    for (int a = 0; a < 4; ++a)
      out[2 * data_[k].node[a] + 1] += scale * data_[k].weight * data_[k].share[a] * projected[k];
  return out;
}

std::vector<double> DisplacementData::weighted(const Fit& fit) const {
  std::vector<double> out = fit.residual;
  for (double& r : out) r *= std::sqrt(independence_);
  return out;
}

// With A = (modelled, 1), W the weights, S the interpolation and U the columns: U^T S^T (W - W A (A^T W A)^-1
// A^T W) S U.
DisplacementData::Products DisplacementData::products(const Fit& fit,
                                                      const StripModel::NodeColumns& u) const {
  StripModel::NodeColumns weighted = StripModel::NodeColumns::Zero(u.rows(), u.cols());  // S^T W S U
  Eigen::MatrixXd line = Eigen::MatrixXd::Zero(2, u.cols());                             // A^T W S U
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::RowVectorXd seen(u.cols());
  for (std::size_t k = 0; k < data_.size(); ++k) {
    if (k % kDataAtOnce == 0) check_cancelled();
    const Datum& d = data_[k];
    seen.setZero();
    for (int a = 0; a < 4; ++a) seen += d.share[a] * u.row(static_cast<Eigen::Index>(d.node[a]));
    seen *= d.weight * d.weight;
    for (int a = 0; a < 4; ++a) weighted.row(static_cast<Eigen::Index>(d.node[a])) += d.share[a] * seen;
    line.row(0) += fit.modelled[k] * seen;
    line.row(1) += seen;
    const Eigen::Vector2d of(fit.modelled[k], 1);
    normal += d.weight * d.weight * of * of.transpose();
  }
  const Eigen::MatrixXd followed = normal.fullPivLu().solve(line);
  check_cancelled();
  Eigen::MatrixXd of_changes = u.transpose() * weighted;
  of_changes -= line.transpose() * followed;
  of_changes *= fit.amplitude * fit.amplitude * independence_;
  return {std::move(of_changes), -followed.row(0).transpose()};
}

std::vector<double> DisplacementData::weight_of_elements(const TissueGrid& grid, const Fit& fit,
                                                         const std::vector<double>& displacement) const {
  double squares = 0;
  for (const Datum& d : data_) squares += d.weight * d.weight;
  const double each = independence_ * squares / static_cast<double>(grid.elements());
  std::vector<double> out(grid.elements());
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const auto axial = [&](std::size_t a, std::size_t b) {
        return displacement[2 * grid.node(i + a, j + b) + 1];
      };
      const double shortening = 0.5 * fit.amplitude * (axial(0, 0) + axial(1, 0) - axial(0, 1) - axial(1, 1));
      out[grid.element(i, j)] = each * shortening * shortening;
    }
  return out;
}

}  // namespace teletact::service
