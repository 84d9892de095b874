#include "service/imaging/modulus/problem.h"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"

namespace teletact::service {

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
