#include "service/contact/plane_budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "service/base/choices.h"
#include "service/contact/solid_answer.h"

namespace teletact::service {
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
           "what a solid would push back with instead is not known of tissue that is so narrow, or held so";
  const Fingertip usual;
  const double usual_m = std::min(0.002, depth_m_ / 20);
  const PressedLayer layer = pressed(usual, usual_m);
  return plane +
         fmt::format(
             "homogeneous tissue that is no plane would push a round tip of {:.3g} mm back with about "
             "{:.1f} of this force at {:.2g} mm",
             1e3 * usual.radius_m, solid_force_m2(layer) / (thickness_m_ * plane_force_m(layer)),
             1e3 * usual_m);
}

}  // namespace teletact::service
