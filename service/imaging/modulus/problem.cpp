#include "service/imaging/modulus/problem.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"

namespace teletact::service {

namespace {

constexpr std::size_t kCellsAtOnce = 512;  // between two looks

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
// A^T W) S U. Data of one cell see the same nodes, so that S^T W S is a matrix of each cell's nodes.
DisplacementData::Products DisplacementData::products(const Fit& fit,
                                                      const StripModel::NodeColumns& u) const {
  struct Cell {
    const Datum* at = nullptr;
    Eigen::Matrix4d weight = Eigen::Matrix4d::Zero();
  };
  std::vector<Cell> cells(static_cast<std::size_t>(u.rows()));      // by their first nodes
  Eigen::Matrix2Xd of_nodes = Eigen::Matrix2Xd::Zero(2, u.rows());  // A^T W S
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  for (std::size_t k = 0; k < data_.size(); ++k) {
    const Datum& d = data_[k];
    const double weight = d.weight * d.weight;
    const Eigen::Vector4d share = Eigen::Map<const Eigen::Vector4f>(d.share).cast<double>();
    const Eigen::Vector2d of(fit.modelled[k], 1);
    Cell& cell = cells[d.node[0]];
    cell.at = &d;
    cell.weight += weight * share * share.transpose();
    for (int a = 0; a < 4; ++a) of_nodes.col(static_cast<Eigen::Index>(d.node[a])) += weight * share[a] * of;
    normal += weight * of * of.transpose();
  }
  check_cancelled();
  StripModel::NodeColumns weighted = StripModel::NodeColumns::Zero(u.rows(), u.cols());  // S^T W S U
  for (std::size_t n = 0; n < cells.size(); ++n) {
    if (n % kCellsAtOnce == 0) check_cancelled();
    const Cell& cell = cells[n];
    for (int a = 0; cell.at && a < 4; ++a)
      for (int b = 0; b < 4; ++b)
        weighted.row(static_cast<Eigen::Index>(cell.at->node[a])) +=
            cell.weight(a, b) * u.row(static_cast<Eigen::Index>(cell.at->node[b]));
  }
  const Eigen::MatrixXd line = of_nodes * u, followed = normal.fullPivLu().solve(line);
  Eigen::MatrixXd half(u.cols(), u.cols());
  half.triangularView<Eigen::Lower>() = u.transpose() * weighted;
  half.triangularView<Eigen::Lower>() -= line.transpose() * followed;
  const Eigen::MatrixXd of_changes = half.selfadjointView<Eigen::Lower>();
  return {fit.amplitude * fit.amplitude * independence_ * of_changes, -followed.row(0).transpose()};
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

using Eigen::VectorXd;

namespace {

constexpr double kLargestStep = 1.0;  // of log E, in one Gauss-Newton step
constexpr double kSeenBy = 3;         // an element's shortening is seen by the data of about so many
constexpr int kMaxProducts = 12;      // J^T J products within one step
constexpr std::size_t kRememberedProducts = 24;  // of the steps before, that correct the preconditioner
constexpr double kInnerTolerance = 0.05;         // residual of the inner conjugate gradients

}  // namespace

VectorXd prior_weight(const StripModel& model) {
  const TissueGrid& g = model.grid();
  const double per_m2 = 1 / (kPriorDeviation * kPriorDeviation * 1e-6);
  VectorXd out(static_cast<Eigen::Index>(g.elements()));
  for (std::size_t e = 0; e < g.elements(); ++e) {
    const std::size_t i = e % (g.nx() - 1), j = e / (g.nx() - 1);
    const bool under = i >= model.first_column() && i < model.last_column();
    out[static_cast<Eigen::Index>(e)] =
        (under ? 1 : kPriorBeside) * per_m2 * (g.x_m[i + 1] - g.x_m[i]) * (g.y_m[j + 1] - g.y_m[j]);
  }
  return out;
}

ModulusProblem::ModulusProblem(StripModel& model, DisplacementData data, VectorXd prior, double background)
    : model_(model),
      data_(std::move(data)),
      prior_(std::move(prior)),
      background_(background),
      variation_(model.grid()),
      prior_weight_(prior_weight(model)) {}

ModulusProblem::Point ModulusProblem::at(VectorXd theta) {
  Point p{std::move(theta), {}, {}, 0};
  p.response = model_.solve(modulus(p.theta));
  check_cancelled();
  p.fit = data_.fit(p.response.displacement);
  check_cancelled();
  const VectorXd off = p.theta - prior_;
  p.objective =
      p.fit.misfit + kTvPerM * variation_.value(p.theta) + 0.5 * off.dot(prior_weight_.cwiseProduct(off));
  return p;
}

VectorXd ModulusProblem::gradient(const Point& p) {
  return kTvPerM * (variation_.lagged(p.theta) * p.theta) + prior_weight_.cwiseProduct(p.theta - prior_) +
         adjoint(p, modulus(p.theta), data_.weighted(p.fit));
}

VectorXd ModulusProblem::step(const Point& p) {
  const std::vector<double> e = modulus(p.theta);
  const Eigen::SparseMatrix<double> lagged = kTvPerM * variation_.lagged(p.theta);
  check_cancelled();
  VectorXd r = -gradient(p);
  // Stands for J^T J: an element's own shortening, seen by the data of a few elements.
  const std::vector<double> own = data_.weight_of_elements(model_.grid(), p.fit, p.response.displacement);
  const VectorXd data_weight = kSeenBy * Eigen::Map<const VectorXd>(own.data(), p.theta.size());
  Eigen::SparseMatrix<double> near = lagged;
  near.diagonal() += prior_weight_ + data_weight;
  check_cancelled();
  if (!preconditioner_.analyzed())
    preconditioner_.analyze(near, nested_dissection(model_.grid().nx() - 1, model_.grid().ny() - 1));
  if (!preconditioner_.factorize(near))
    throw std::domain_error("the prior of the modulus is not positive definite");
  const std::size_t known = products_.size();
  VectorXd step = VectorXd::Zero(r.size()), z = preconditioned(r, known), d = z;
  double rz = r.dot(z);
  const double enough = kInnerTolerance * kInnerTolerance * rz;
  for (int k = 0; k < kMaxProducts && rz > enough; ++k) {
    check_cancelled();
    const VectorXd h = lagged * d + prior_weight_.cwiseProduct(d) + adjoint(p, e, forward(p, e, d));
    const double dh = d.dot(h), length = rz / dh;
    products_.push_back({d, h, dh});
    step += length * d;
    r -= length * h;
    z = preconditioned(r, known);
    const double next = r.dot(z);
    d = z + next / rz * d;
    rz = next;
  }
  while (products_.size() > kRememberedProducts) products_.pop_front();
  const double largest = step.cwiseAbs().maxCoeff();
  return largest > kLargestStep ? VectorXd(kLargestStep / largest * step) : step;
}

// The inverse of L-BFGS (two loops) about the preconditioner, with the first `products`.
VectorXd ModulusProblem::preconditioned(VectorXd residual, std::size_t products) const {
  std::vector<double> along(products);
  for (std::size_t k = products; k-- > 0;) {
    along[k] = products_[k].s.dot(residual) / products_[k].sy;
    residual -= along[k] * products_[k].y;
  }
  VectorXd z = preconditioner_.solve(residual);
  for (std::size_t k = 0; k < products; ++k)
    z += (along[k] - products_[k].y.dot(z) / products_[k].sy) * products_[k].s;
  return z;
}

std::vector<double> ModulusProblem::modulus(const VectorXd& theta) const {
  std::vector<double> e(static_cast<std::size_t>(theta.size()));
  for (std::size_t k = 0; k < e.size(); ++k)
    e[k] = background_ * std::exp(theta[static_cast<Eigen::Index>(k)]);
  return e;
}

// J d: dE = E d.
std::vector<double> ModulusProblem::forward(const Point& p, const std::vector<double>& e, const VectorXd& d) {
  std::vector<double> change(e.size());
  for (std::size_t k = 0; k < e.size(); ++k) change[k] = e[k] * d[static_cast<Eigen::Index>(k)];
  return data_.change(p.fit, model_.change(p.response, change));
}

VectorXd ModulusProblem::adjoint(const Point& p, const std::vector<double>& e,
                                 const std::vector<double>& residual) {
  const std::vector<double> s = model_.sensitivity(p.response, data_.transposed(p.fit, residual));
  VectorXd out(static_cast<Eigen::Index>(e.size()));
  for (std::size_t k = 0; k < e.size(); ++k) out[static_cast<Eigen::Index>(k)] = e[k] * s[k];
  return out;
}

}  // namespace teletact::service
