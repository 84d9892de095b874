#include "service/imaging/modulus/denoiser.h"

#include <stdexcept>

#include "service/device/cancellation.h"

namespace teletact::service {
namespace {

using Eigen::VectorXd;

// Of ln E, steeper than texture: a lump of 10 mm loses 0.06 of ln 3 to plain total variation.
constexpr double kEdgePerM = 100;
constexpr double kMinWeight = 1e-6;  // so that a map of nothing has an answer

TissueGrid mesh_of(const CellGrid& cells) {
  TissueGrid grid;
  for (std::size_t i = 0; i <= cells.columns; ++i)
    grid.x_m.push_back(cells.first_x_m + cells.spacing_m * (static_cast<double>(i) - 0.5));
  for (std::size_t j = 0; j <= cells.rows; ++j) grid.y_m.push_back(cells.row_m * static_cast<double>(j));
  return grid;
}

}  // namespace

Denoiser::Denoiser(const CellGrid& cells)
    : grid_(mesh_of(cells)), variation_(grid_), order_(nested_dissection(cells.columns, cells.rows)) {}

VectorXd Denoiser::operator()(const VectorXd& observed, const VectorXd& weight, const VectorXd& v) {
  factorize(weight, v);
  return factor_.solve(weight.cwiseProduct(observed));
}

double Denoiser::cost(const VectorXd& left, const VectorXd& weight, const VectorXd& v) const {
  return left.dot(weight.cwiseProduct(left)) / 2 + kTvPerM * variation_.value(v, kEdgePerM);
}

VectorXd Denoiser::deviation(const VectorXd& weight, const VectorXd& v) {
  factorize(weight, v);
  return factor_.inverse_diagonal().cwiseMax(0).cwiseSqrt();
}

void Denoiser::factorize(const VectorXd& weight, const VectorXd& v) {
  check_cancelled();
  Eigen::SparseMatrix<double> matrix = kTvPerM * variation_.lagged(v, kEdgePerM);
  matrix.diagonal() += (weight.array() + kMinWeight).matrix();
  if (!factor_.analyzed()) factor_.analyze(matrix, order_);
  if (!factor_.factorize(matrix)) throw std::domain_error("the modulus of the cells is not determined");
}

}  // namespace teletact::service
