#include "service/imaging/modulus/robust_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kTextureLog = 0.1;  // of ln E of what still looks homogeneous
constexpr double kMinRest = 0.02;
constexpr double kCauchy = 1.5;  // in scales
constexpr int kReweighted = 12;

}  // namespace

RobustFit fit_robustly(const VectorXd& field, const VectorXd& told, const std::vector<FitColumn>& columns,
                       double places, double scale) {
  std::vector<Index> cells;
  for (Index c = 0; c < field.size(); ++c)
    if (told[c] > 0) cells.push_back(c);
  const auto rows = static_cast<Index>(cells.size()), count = static_cast<Index>(columns.size());
  VectorXd values(rows), left;
  MatrixXd of(rows, count + 1);
  for (Index r = 0; r < rows; ++r) {
    values[r] = field[cells[static_cast<std::size_t>(r)]], of(r, 0) = 1;
    for (Index k = 0; k < count; ++k)
      of(r, k + 1) = columns[static_cast<std::size_t>(k)].by[cells[static_cast<std::size_t>(r)]];
  }
  VectorXd at = VectorXd::Zero(count + 1);
  std::vector<double> sizes(values.begin(), values.end());
  at[0] = median(sizes);
  RobustFit out;
  out.rest = kTextureLog;
  left = values - of * at;
  Eigen::LLT<MatrixXd> factor;
  for (int pass = 0; pass < kReweighted; ++pass) {
    const double by = scale > 0 ? scale : out.rest;
    const VectorXd share = places / squared(by) / (1 + (left.array() / (kCauchy * by)).square());
    MatrixXd held = MatrixXd::Zero(count + 1, count + 1),
             information = of.transpose() * share.asDiagonal() * of;
    VectorXd load = of.transpose() * share.cwiseProduct(values);
    for (Index k = 0; k < count; ++k) {
      const FitColumn& column = columns[static_cast<std::size_t>(k)];
      const double away = (at[k + 1] - column.usual) / column.deviation,
                   known = 1 / squared(column.deviation) / (column.doubted ? 1 + squared(away) / 2 : 1);
      information(k + 1, k + 1) += known, load[k + 1] += known * column.usual;
      held(k + 1, k + 1) = 1 / squared(column.reach);
    }
    at = (information + held).llt().solve(load);
    factor.compute(information);
    left = values - of * at;
    std::ranges::transform(left, sizes.begin(), [](double v) { return std::abs(v); });
    out.rest = std::max(1.48 * median(sizes), kMinRest);
  }
  out.at = at.tail(count);
  out.left = VectorXd::Zero(field.size());
  for (Index r = 0; r < rows; ++r) out.left[cells[static_cast<std::size_t>(r)]] = left[r];
  out.covariance = factor.solve(MatrixXd::Identity(count + 1, count + 1)).bottomRightCorner(count, count);
  const double by = kCauchy * (scale > 0 ? scale : out.rest);
  out.misfit = places * squared(kCauchy) / 2 * (1 + (left.array() / by).square()).log().sum() +
               factor.matrixLLT().diagonal().array().log().sum();
  for (Index k = 0; k < count; ++k) {
    const FitColumn& column = columns[static_cast<std::size_t>(k)];
    const double away = squared((out.at[k] - column.usual) / column.deviation) / 2;
    out.misfit += (column.doubted ? std::log(1 + away) : away) + std::log(column.deviation);
  }
  return out;
}

std::vector<VectorXd> principal(const MatrixXd& columns, std::size_t most) {
  constexpr double kLeast = 1e-3;  // of all
  const Eigen::SelfAdjointEigenSolver<MatrixXd> of(columns.transpose() * columns);
  std::vector<VectorXd> out;
  for (Index k = columns.cols() - 1; k >= 0 && out.size() < most; --k)
    if (of.eigenvalues()[k] > kLeast * of.eigenvalues().sum())
      out.push_back(columns * of.eigenvectors().col(k));
  return out;
}

}  // namespace teletact::service
