#include "bench/phantoms/drawn_window.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <utility>

#include "bench/phantoms/given_measurement.h"
#include "service/imaging/modulus/problem.h"
#include "tests/reference/elasticity.h"

namespace teletact::bench {
namespace {

using Eigen::VectorXd;
using service::ImageGrid;
using service::TissueGrid;

constexpr double kFineM = 0.52e-3, kElevationM = 0.010;
constexpr std::size_t kRows = 74;
constexpr const ImageGrid& kImage = kGivenImage;

std::size_t cell_of(const std::vector<double>& coordinates, double at) {
  const auto upper = std::upper_bound(coordinates.begin(), coordinates.end(), at) - coordinates.begin();
  return static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(upper - 1, 0, static_cast<std::ptrdiff_t>(coordinates.size()) - 2));
}

double centre(const std::vector<double>& coordinates, std::size_t cell) {
  return 0.5 * (coordinates[cell] + coordinates[cell + 1]);
}

}  // namespace

DrawnWindow::DrawnWindow(const DrawnCase& of, std::uint64_t seed, service::Queue queue)
    : of_(of), tissue_{kTissueM, of.depth_m, (kTissueM - kWindowM) / 2} {
  std::mt19937_64 random(seed);
  const double radius_m = of.diameter_m / 2;
  x_m_ = std::uniform_real_distribution<double>(0.010 + radius_m, kWindowM - 0.010 - radius_m)(random);
  const double shallowest_m = 0.005 + radius_m,
               deepest_m = std::min(0.020 + radius_m / 2, of.depth_m - radius_m);
  y_m_ = std::uniform_real_distribution<double>(shallowest_m, std::max(shallowest_m, deepest_m))(random);
  draw_texture(random());
  measure(queue, press(), random());
}

double DrawnWindow::lump(double x_m, double y_m) const {
  return 2 * std::hypot(x_m - x_m_, y_m - y_m_) < of_.diameter_m ? std::log(of_.contrast) : 0;
}

double DrawnWindow::log_modulus(double x_m, double y_m) const {
  return std::log(kBackgroundPa) + lump(x_m, y_m) +
         texture_[strip_.element(cell_of(strip_.x_m, x_m), cell_of(strip_.y_m, y_m))];
}

double DrawnWindow::log_modulus(std::size_t node) const {
  return log_modulus(grid().x_m(node), grid().y_m(node));
}

double DrawnWindow::from_edge_m(std::size_t node) const {
  return std::hypot(grid().x_m(node) - x_m_, grid().y_m(node) - y_m_) - of_.diameter_m / 2;
}

// Gaussian, of the precision that the iterative method has about the lump.
void DrawnWindow::draw_texture(std::uint64_t seed) {
  const service::StripModel model(tissue_, kWindowM);
  strip_ = model.grid();
  texture_.assign(strip_.elements(), 0.0);
  if (!of_.texture) return;
  VectorXd theta(static_cast<Eigen::Index>(strip_.elements())), white = theta;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  for (std::size_t j = 0; j + 1 < strip_.ny(); ++j)
    for (std::size_t i = 0; i + 1 < strip_.nx(); ++i) {
      const auto e = static_cast<Eigen::Index>(strip_.element(i, j));
      theta[e] = lump(centre(strip_.x_m, i), centre(strip_.y_m, j));
      white[e] = normal(random);
    }
  const service::TotalVariation variation(strip_);
  Eigen::SparseMatrix<double> precision = service::kTvPerM * variation.lagged(theta);
  precision.diagonal() += service::prior_weight(model);
  const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> factor(precision);
  if (factor.info() != Eigen::Success) throw std::domain_error("the prior is not positive definite");
  VectorXd drawn = factor.matrixU().solve(white);
  drawn = factor.permutationPinv() * drawn;
  texture_.assign(drawn.begin(), drawn.end());
}

std::vector<double> DrawnWindow::press() {
  const double left = tissue_.window_x_m, push_m = of_.strain * of_.depth_m;
  TissueGrid fine;
  fine.x_m = service::graded_coordinates(-left, kTissueM - left, 0, kWindowM, kFineM, 6e-3, 1.3);
  fine.y_m = service::uniform_coordinates(0, of_.depth_m, kRows);
  service::Material material;
  material.poisson_ratio = tissue_.poisson_ratio;
  constexpr int kWithin = 4;  // an edge runs through an element
  for (std::size_t j = 0; j + 1 < fine.ny(); ++j)
    for (std::size_t i = 0; i + 1 < fine.nx(); ++i) {
      double sum = 0;
      for (int k = 0; k < kWithin * kWithin; ++k) {
        const double s = (k % kWithin + 0.5) / kWithin, t = (k / kWithin + 0.5) / kWithin;
        sum += log_modulus((1 - s) * fine.x_m[i] + s * fine.x_m[i + 1],
                           (1 - t) * fine.y_m[j] + t * fine.y_m[j + 1]);
      }
      material.youngs_modulus_pa.push_back(std::exp(sum / (kWithin * kWithin)));
    }
  const Eigen::SparseMatrix<double> k = reference::assemble(fine, material);
  std::vector<std::size_t> held;
  VectorXd pushed = VectorXd::Zero(k.rows());
  for (std::size_t i = 0; i < fine.nx(); ++i) {
    const std::size_t top = 2 * fine.node(i, 0) + 1, bottom = 2 * fine.node(i, fine.ny() - 1);
    held.insert(held.end(), {bottom, bottom + 1});
    if (fine.x_m[i] < -1e-9 || fine.x_m[i] > kWindowM + 1e-9) continue;
    held.push_back(top);
    pushed[static_cast<Eigen::Index>(top)] = push_m;
  }
  VectorXd load = -(k * pushed);
  for (const std::size_t d : held) load[static_cast<Eigen::Index>(d)] = 0;
  std::sort(held.begin(), held.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(reference::with_fixed(k, held));
  const VectorXd u = pushed + factor.solve(load);
  force_ = {u.dot(k * u) / push_m * kElevationM, kWindowM * kElevationM};
  std::vector<double> axial;
  for (std::size_t n = 0; n < kImage.size(); ++n) {
    const std::size_t i = cell_of(fine.x_m, kImage.x_m(n)), j = cell_of(fine.y_m, kImage.y_m(n));
    const double s = (kImage.x_m(n) - fine.x_m[i]) / (fine.x_m[i + 1] - fine.x_m[i]),
                 t = (kImage.y_m(n) - fine.y_m[j]) / (fine.y_m[j + 1] - fine.y_m[j]);
    const auto at = [&](std::size_t a, std::size_t b) {
      return u[static_cast<Eigen::Index>(2 * fine.node(i + a, j + b) + 1)];
    };
    axial.push_back((1 - t) * ((1 - s) * at(0, 0) + s * at(1, 0)) + t * ((1 - s) * at(0, 1) + s * at(1, 1)));
  }
  return axial;
}

void DrawnWindow::measure(const service::Queue& queue, std::vector<double> axial, std::uint64_t seed) {
  std::vector<double> lateral(axial.size());
  std::vector<std::uint8_t> in_tissue(axial.size());
  for (std::size_t n = 0; n < kImage.size(); ++n) in_tissue[n] = kImage.y_m(n) <= of_.depth_m;
  measured_ =
      measured_of(queue, {std::move(axial), std::move(lateral), std::move(in_tissue), of_.noise_m}, seed);
}

service::ModulusInput DrawnWindow::input() const {
  return {measured_, kWindowM, tissue_, force_, {}};
}

}  // namespace teletact::bench
