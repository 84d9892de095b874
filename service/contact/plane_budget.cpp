#include "service/contact/plane_budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "service/base/choices.h"
#include "service/contact/solid_answer.h"

namespace teletact::service {

namespace {

using std::numbers::pi;

// Logarithms of what the ratio of both forces may be off by at most (plane_dimension_test): by the closed
// forms of narrow contacts; of wide ones, times the square of the plane's half-width over the depth; and by
// lumps and layers, of a spread s times s / (1 + s).
constexpr double kOfForms = 0.06, kOfWide = 3, kOfSpread = 0.6;

// Over Young's modulus.
double plane_strain_modulus(const PressedLayer& layer) {
  return 1 / (1 - layer.poisson_ratio * layer.poisson_ratio);
}

// Half of the plane's contact, a: F' = pi E* a^2 / (4 R), d = a^2 / (4 R) (2 ln(2 h / a) - nu / (1 - nu)).
// known_m: the indentation that it is of, no deeper than where d grows no more.
struct PlaneContact {
  double a_m, known_m;
};
PlaneContact plane_contact(const PressedLayer& layer) {
  const double of_nu = layer.poisson_ratio / (1 - layer.poisson_ratio);
  const auto indentation_m = [&](double a) {
    return a * a / (4 * layer.radius_m) * (2 * std::log(2 * layer.depth_m / a) - of_nu);
  };
  double least = 0, most = 2 * layer.depth_m * std::exp(-(1 + of_nu) / 2);
  const double known_m = std::min(layer.indentation_m, indentation_m(most));
  for (int halving = 0; halving < 60; ++halving) {
    const double a = (least + most) / 2;
    (indentation_m(a) < known_m ? least : most) = a;
  }
  return {most, known_m};
}

}  // namespace

double solid_force_m2(const PressedLayer& layer) {
  const double nu = layer.poisson_ratio, alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu),
               beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu),
               radius_m = std::sqrt(layer.radius_m * layer.indentation_m), chi = radius_m / layer.depth_m,
               cube = alpha * alpha * alpha;
  const double layered = 1 - 2 * alpha / pi * chi + 4 * alpha * alpha / (pi * pi) * chi * chi -
                         8 / std::pow(pi, 3) * (cube + 4 * pi * pi / 15 * beta) * std::pow(chi, 3) +
                         16 * alpha / std::pow(pi, 4) * (cube + 3 * pi * pi / 5 * beta) * std::pow(chi, 4);
  return 4.0 / 3 * plane_strain_modulus(layer) * radius_m * layer.indentation_m * layered;
}

double plane_force_m(const PressedLayer& layer) {
  const auto [a, known_m] = plane_contact(layer);
  return pi * plane_strain_modulus(layer) * a * a / (4 * layer.radius_m) * layer.indentation_m / known_m;
}

double dimension_half_width(const PressedLayer& layer, double thickness_m, double spread) {
  const double layered = solid_force_m2(layer) / (thickness_m * plane_force_m(layer)),
               wide = plane_contact(layer).a_m / layer.depth_m,
               spreads = std::exp(kOfForms + kOfWide * wide * wide + kOfSpread * spread / (1 + spread));
  return std::max(std::abs(layered * spreads - 1), std::abs(layered / spreads - 1));
}

namespace {

// Of the force: of columns of nodes as far apart as a round tip touches each side, as a share of the square;
// and of rows (plane_dimension_test).
constexpr double kOfColumns = 0.165, kOfRows = 0.02;
// Depths of tissue that must lie on each side for it to be wide.
constexpr double kWide = 1.5;

struct Moments {
  double area = 0, sum = 0, squares = 0;  // of ln E over an area
  void add(const Moments& other) { area += other.area, sum += other.sum, squares += other.squares; }
  double deviation() const {
    const double mean = sum / area;
    return std::sqrt(std::max(0.0, squares / area - mean * mean));
  }
};

// Of each column of elements, as deep as touches feel.
std::vector<Moments> moments_of_columns(const TissueProblem& tissue) {
  const TissueGrid& grid = tissue.grid;
  std::vector<Moments> columns(grid.nx() - 1);
  for (std::size_t j = 0; j + 1 < grid.ny() && grid.y_m[j] < choices::kFeltDepth; ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const double size = (grid.x_m[i + 1] - grid.x_m[i]) * (grid.y_m[j + 1] - grid.y_m[j]),
                   log_pa = std::log(tissue.material.youngs_modulus_pa[grid.element(i, j)]);
      columns[i].add({size, size * log_pa, size * log_pa * log_pa});
    }
  return columns;
}

std::vector<double> felt_spreads(const TissueProblem& tissue) {
  const std::vector<double>& x_m = tissue.grid.x_m;
  const std::vector<Moments> columns = moments_of_columns(tissue);
  std::vector<double> spreads;
  for (const double at_m : x_m) {
    Moments felt;
    for (std::size_t i = 0; i < columns.size(); ++i)
      if (x_m[i + 1] > at_m - choices::kWidestReach && x_m[i] < at_m + choices::kWidestReach)
        felt.add(columns[i]);
    spreads.push_back(felt.deviation());
  }
  return spreads;
}

}  // namespace

PlaneBudget::PlaneBudget(const TissueProblem& tissue)
    : thickness_m_(tissue.thickness_m),
      poisson_ratio_(tissue.material.poisson_ratio),
      first_row_m_(tissue.grid.y_m[1]),
      free_on_held_(tissue.supports.top == EdgeSupport::kFree &&
                    tissue.supports.bottom == EdgeSupport::kFixed),
      x_m_(tissue.grid.x_m),
      depth_m_(tissue.grid.y_m.back()),
      spreads_(felt_spreads(tissue)) {}

PressedLayer PlaneBudget::pressed(const Fingertip& tip, double indentation_m) const {
  return {poisson_ratio_, depth_m_, tip.radius_m, indentation_m};
}

bool PlaneBudget::wide_around(double x_m) const {
  return free_on_held_ && std::min(x_m - x_m_.front(), x_m_.back() - x_m) >= kWide * depth_m_;
}

void PlaneBudget::add(const Fingertip& tip, double x_m, double indentation_m, ContactAnswer& answer) const {
  const auto beyond = std::upper_bound(x_m_.begin() + 1, x_m_.end() - 1, x_m);
  const auto right = static_cast<std::size_t>(beyond - x_m_.begin());
  const double spread = std::max(spreads_[right - 1], spreads_[right]),
               reach_m = std::sqrt(2 * tip.radius_m * indentation_m);
  double apart_m = 0;
  for (std::size_t i = 0; i + 1 < x_m_.size(); ++i)
    if (x_m_[i + 1] > x_m - reach_m && x_m_[i] < x_m + reach_m)
      apart_m = std::max(apart_m, x_m_[i + 1] - x_m_[i]);
  double lacks = dimension_half_width(pressed(tip, indentation_m), thickness_m_, spread);
  if (!wide_around(x_m)) lacks = std::max(lacks, 1.0);  // nobody knows
  answer.budget.add({ErrorTerm::kSolver, TermKind::kBound, answer.solve.relative_error});
  const double touched_m = std::sqrt(tip.radius_m * indentation_m), columns = apart_m / touched_m;
  answer.budget.add({ErrorTerm::kMesh, TermKind::kEstimate,
                     kOfColumns * columns * columns + kOfRows * first_row_m_ / touched_m});
  answer.budget.add(finite_strain(tip, indentation_m));
  answer.budget.add({ErrorTerm::kDimension, TermKind::kEstimate, lacks / ForceBudget::kOf95});
}

std::string PlaneBudget::words() const {
  const std::string plane = fmt::format("plane strain, {:.3g} mm thick: ", 1e3 * thickness_m_);
  if (!wide_around((x_m_.front() + x_m_.back()) / 2))
    return plane +
           "how much harder a solid would push back is not known for tissue as narrow, or held, as this";
  const Fingertip usual;
  const double usual_m = std::min(0.002, depth_m_ / 20);
  const PressedLayer layer = pressed(usual, usual_m);
  return plane + fmt::format(
                     "homogeneous solid tissue would push a round tip of {:.3g} mm back with about "
                     "{:.1f} times this force at {:.2g} mm",
                     1e3 * usual.radius_m, solid_force_m2(layer) / (thickness_m_ * plane_force_m(layer)),
                     1e3 * usual_m);
}

}  // namespace teletact::service
