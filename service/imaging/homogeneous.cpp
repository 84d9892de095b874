// K u = 0 on the free degrees of freedom, u_y = 1 on the surface under the probe, u = 0 on the bottom;
// P = sum of the reactions K u on the prescribed nodes (the multipliers of T4.1).
#include "service/imaging/homogeneous.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/tissue/element.h"
#include "service/tissue/grid.h"

namespace teletact::service {
namespace {

constexpr double kContextM = 0.060, kFineM = 1e-3, kCoarseM = 8e-3, kGrowth = 1.3;
constexpr double kSlackM = 1e-6;  // rounding of a window that ends with its tissue

struct Context {
  double left_m, right_m;
};

Context context(const TissueExtent& t, double window_width_m) {
  if (!(t.depth_m > 1e-3 && t.depth_m < 1))
    throw std::invalid_argument("depth_m: must be above 1e-3 m and below 1 m");
  if (!(t.width_m > 0 && t.width_m < 100))
    throw std::invalid_argument("width_m: must be above 0 m and below 100 m");
  if (!(t.poisson_ratio >= 0 && t.poisson_ratio < 0.5))
    throw std::invalid_argument("poisson_ratio: must be 0 <= nu < 0.5; tissue is about 0.49");
  const double right = t.width_m - t.window_x_m - window_width_m;
  if (!(t.window_x_m >= -kSlackM && right >= -kSlackM))
    throw std::invalid_argument("window_x_m: the window [" + std::to_string(t.window_x_m) + ", " +
                                std::to_string(t.window_x_m + window_width_m) +
                                ") m is not inside the tissue [0, " + std::to_string(t.width_m) + "] m");
  return {std::clamp(t.window_x_m, 0.0, kContextM), std::clamp(right, 0.0, kContextM)};
}

// The strip in window coordinates: grid of columns from -left to width + right, shifted to start anywhere.
TissueGrid strip(const Context& c, double depth_m, double window_width_m) {
  TissueGrid grid;
  grid.x_m =
      graded_coordinates(-c.left_m, window_width_m + c.right_m, 0, window_width_m, kFineM, kCoarseM, kGrowth);
  grid.y_m =
      uniform_coordinates(0, depth_m, static_cast<std::size_t>(std::max(4.0, std::ceil(depth_m / kFineM))));
  return grid;
}

using Sparse = Eigen::SparseMatrix<double>;

Sparse assemble(const TissueGrid& g, double poisson_ratio) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(64 * g.elements());
  for (std::size_t j = 0; j + 1 < g.ny(); ++j)
    for (std::size_t i = 0; i + 1 < g.nx(); ++i) {
      const auto k = element_stiffness(g.x_m[i + 1] - g.x_m[i], g.y_m[j + 1] - g.y_m[j], 1.0, poisson_ratio);
      const std::size_t nodes[] = {g.node(i, j), g.node(i + 1, j), g.node(i, j + 1), g.node(i + 1, j + 1)};
      for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c)
          entries.emplace_back(static_cast<int>(2 * nodes[r / 2]) + r % 2,
                               static_cast<int>(2 * nodes[c / 2]) + c % 2, k(r, c));
    }
  Sparse stiffness(static_cast<Eigen::Index>(g.dofs()), static_cast<Eigen::Index>(g.dofs()));
  stiffness.setFromTriplets(entries.begin(), entries.end());
  return stiffness;
}

struct Solution {
  Eigen::VectorXd displacement;
  double force_n_per_m;
};

Solution solve(const TissueGrid& g, double poisson_ratio, double window_width_m) {
  const Sparse stiffness = assemble(g, poisson_ratio);
  Eigen::VectorXd u = Eigen::VectorXd::Zero(stiffness.rows());
  std::vector<int> free_index(g.dofs(), 0);  // -1: prescribed
  std::vector<Eigen::Index> pushed;
  for (std::size_t i = 0; i < g.nx(); ++i) {
    for (int a = 0; a < 2; ++a) free_index[2 * g.node(i, g.ny() - 1) + static_cast<std::size_t>(a)] = -1;
    if (g.x_m[i] < -kSlackM || g.x_m[i] > window_width_m + kSlackM) continue;
    pushed.push_back(static_cast<Eigen::Index>(2 * g.node(i, 0) + 1));
    free_index[2 * g.node(i, 0) + 1] = -1;
    u[pushed.back()] = 1;
  }
  int free_count = 0;
  for (int& index : free_index)
    if (index == 0) index = free_count++;
  const Eigen::VectorXd load = -(stiffness * u);
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right(free_count);
  for (int c = 0; c < stiffness.outerSize(); ++c) {
    const int column = free_index[static_cast<std::size_t>(c)];
    if (column < 0) continue;
    right[column] = load[c];
    for (Sparse::InnerIterator it(stiffness, c); it; ++it)
      if (const int row = free_index[static_cast<std::size_t>(it.row())]; row >= 0)
        entries.emplace_back(row, column, it.value());
  }
  Sparse reduced(free_count, free_count);
  reduced.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLLT<Sparse> factor(reduced);
  if (factor.info() != Eigen::Success)
    throw std::runtime_error("homogeneous reference: the stiffness of the strip is not positive definite");
  const Eigen::VectorXd unknown = factor.solve(right);
  for (std::size_t d = 0; d < g.dofs(); ++d)
    if (free_index[d] >= 0) u[static_cast<Eigen::Index>(d)] = unknown[free_index[d]];
  const Eigen::VectorXd reaction = stiffness * u;
  double force = 0;
  for (const Eigen::Index d : pushed) force += reaction[d];
  return {std::move(u), force};
}

// eps_yy at the centre of every element.
std::vector<double> element_strain(const TissueGrid& g, const Eigen::VectorXd& u) {
  std::vector<double> strain(g.elements());
  const auto uy = [&](std::size_t i, std::size_t j) {
    return u[static_cast<Eigen::Index>(2 * g.node(i, j) + 1)];
  };
  for (std::size_t j = 0; j + 1 < g.ny(); ++j)
    for (std::size_t i = 0; i + 1 < g.nx(); ++i)
      strain[g.element(i, j)] =
          (uy(i, j + 1) + uy(i + 1, j + 1) - uy(i, j) - uy(i + 1, j)) / (2 * (g.y_m[j + 1] - g.y_m[j]));
  return strain;
}

struct Position {
  std::size_t cell;
  double fraction;  // towards cell + 1
};

// Between the centres of the intervals of `coordinates`, held outside the first and last centre.
Position between_centres(const std::vector<double>& coordinates, double at) {
  const std::size_t cells = coordinates.size() - 1;
  const auto centre = [&](std::size_t c) { return 0.5 * (coordinates[c] + coordinates[c + 1]); };
  const auto upper = std::upper_bound(coordinates.begin(), coordinates.end(), at) - coordinates.begin();
  std::size_t c = static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(upper - 1, 0, static_cast<std::ptrdiff_t>(cells) - 1));
  if (at < centre(c) && c > 0) --c;
  if (c + 1 >= cells) return {cells - 2, 1.0};
  return {c, std::clamp((at - centre(c)) / (centre(c + 1) - centre(c)), 0.0, 1.0)};
}

Field on_image(const TissueGrid& g, const std::vector<double>& strain, const ImageGrid& image) {
  Field field(image.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t j = 0; j < image.ny; ++j) {
    const double y = image.origin_y_m + static_cast<double>(j) * image.dy_m;
    if (y > g.y_m.back()) continue;
    const Position v = between_centres(g.y_m, y);
    for (std::size_t i = 0; i < image.nx; ++i) {
      const Position h = between_centres(g.x_m, image.origin_x_m + static_cast<double>(i) * image.dx_m);
      const auto at = [&](std::size_t a, std::size_t b) { return strain[g.element(h.cell + a, v.cell + b)]; };
      field[i + image.nx * j] =
          static_cast<float>((1 - v.fraction) * ((1 - h.fraction) * at(0, 0) + h.fraction * at(1, 0)) +
                             v.fraction * ((1 - h.fraction) * at(0, 1) + h.fraction * at(1, 1)));
    }
  }
  return field;
}

}  // namespace

HomogeneousResponse homogeneous_response(const TissueExtent& tissue, double window_width_m,
                                         const ImageGrid& image) {
  const TissueGrid grid = strip(context(tissue, window_width_m), tissue.depth_m, window_width_m);
  const Solution solution = solve(grid, tissue.poisson_ratio, window_width_m);
  return {on_image(grid, element_strain(grid, solution.displacement), image), solution.force_n_per_m};
}

std::shared_ptr<const HomogeneousResponse> HomogeneousCache::get(const TissueExtent& tissue,
                                                                 double window_width_m,
                                                                 const ImageGrid& grid) {
  const Context c = context(tissue, window_width_m);
  const auto same = [&](const Entry& e) {
    return std::abs(e.left_m - c.left_m) < kSlackM && std::abs(e.right_m - c.right_m) < kSlackM &&
           e.depth_m == tissue.depth_m && e.poisson_ratio == tissue.poisson_ratio &&
           e.width_m == window_width_m && e.grid == grid;
  };
  const auto found = std::find_if(entries_.begin(), entries_.end(), same);
  if (found != entries_.end()) {
    entries_.splice(entries_.begin(), entries_, found);
    return found->response;
  }
  auto response =
      std::make_shared<const HomogeneousResponse>(homogeneous_response(tissue, window_width_m, grid));
  entries_.push_front(
      {c.left_m, c.right_m, tissue.depth_m, tissue.poisson_ratio, window_width_m, grid, response});
  if (entries_.size() > kMost) entries_.pop_back();
  return response;
}

}  // namespace teletact::service
