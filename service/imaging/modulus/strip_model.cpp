// K u = 0 on the unknowns, u_y = 1 on the surface under the probe, u = 0 on the bottom. With u_p the
// prescribed part, K_uu u_u = -K_up u_p, and the force is the energy's derivative: P = u^T K u (unit push).
#include "service/imaging/modulus/strip_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <string>

#include "service/device/cancellation.h"
#include "service/tissue/element.h"

namespace teletact::service {
namespace {

constexpr double kPoissonStep = 1e-3;  // of 0.5 - nu, for a difference quotient
constexpr double kContextM = 0.200, kFineM = 1e-3, kCoarseM = 25e-3, kGrowth = 1.35;
constexpr double kSlackM = 1e-6;  // rounding of a window that ends with its tissue
constexpr int kAtRest = -1, kPushed = -2;
constexpr std::size_t kElementsAtOnce = 8192;  // between two looks: a millisecond

struct Surroundings {
  double left_m, right_m;
};

Surroundings surroundings(const TissueExtent& t, double window_width_m) {
  if (!(t.depth_m > 1e-3 && t.depth_m < 1))
    throw std::invalid_argument("depth_m: must be above 1e-3 m and below 1 m");
  if (!(t.width_m > 0 && t.width_m < 100))
    throw std::invalid_argument("width_m: must be above 0 m and below 100 m");
  if (!(t.poisson_ratio >= 0 && t.poisson_ratio <= TissueExtent::kLargestPoissonRatio))
    throw std::invalid_argument("poisson_ratio: must be 0 <= nu <= 0.49999; tissue is about 0.49");
  const double right = t.width_m - t.window_x_m - window_width_m;
  if (!(t.window_x_m >= -kSlackM && right >= -kSlackM))
    throw std::invalid_argument(
        fmt::format("window_x_m: the window [{}, {}) m is not inside the tissue [0, {}] m", t.window_x_m,
                    t.window_x_m + window_width_m, t.width_m));
  return {std::clamp(t.window_x_m, 0.0, kContextM), std::clamp(right, 0.0, kContextM)};
}

TissueGrid strip(const Surroundings& c, double depth_m, double window_width_m) {
  TissueGrid grid;
  grid.x_m =
      graded_coordinates(-c.left_m, window_width_m + c.right_m, 0, window_width_m, kFineM, kCoarseM, kGrowth);
  const double rows = std::clamp(std::ceil(depth_m / kFineM), 4.0, 200.0);
  grid.y_m = uniform_coordinates(0, depth_m, static_cast<std::size_t>(rows));
  return grid;
}

// Degrees of freedom of element (i, j) in the order of element_stiffness().
std::array<std::size_t, 8> element_dofs(const TissueGrid& g, std::size_t i, std::size_t j) {
  const std::size_t nodes[] = {g.node(i, j), g.node(i + 1, j), g.node(i, j + 1), g.node(i + 1, j + 1)};
  std::array<std::size_t, 8> dofs{};
  for (std::size_t r = 0; r < 8; ++r) dofs[r] = 2 * nodes[r / 2] + r % 2;
  return dofs;
}

using Vector8 = Eigen::Matrix<double, 8, 1>;
Vector8 gather(const std::vector<double>& values, const std::array<std::size_t, 8>& dofs) {
  Vector8 out;
  for (int r = 0; r < 8; ++r) out[r] = values[dofs[static_cast<std::size_t>(r)]];
  return out;
}

// The plane-strain tissue that moves like this one: the same mu; lambda = E nu / (1 - nu^2) in plane stress.
InPlaneStrain in_plane_strain(Plane plane, double nu) {
  if (plane != Plane::kStress) return {nu, 1};
  return {nu / (1 + nu), (1 + 2 * nu) / ((1 + nu) * (1 + nu))};
}

}  // namespace

StripModel::StripModel(const TissueExtent& tissue, double window_width_m)
    : grid_(strip(surroundings(tissue, window_width_m), tissue.depth_m, window_width_m)),
      window_x_m_(tissue.window_x_m),
      window_width_m_(window_width_m),
      plane_(tissue.plane),
      stated_poisson_ratio_(tissue.poisson_ratio),
      equal_(in_plane_strain(tissue.plane, tissue.poisson_ratio)) {
  const double height = grid_.y_m[1] - grid_.y_m[0];
  for (std::size_t i = 0; i + 1 < grid_.nx(); ++i)
    element_.push_back(
        element_stiffness(grid_.x_m[i + 1] - grid_.x_m[i], height, equal_.modulus, equal_.poisson_ratio));
  number_unknowns(window_width_m);
  lay_out();
  std::vector<int> order;
  order.reserve(static_cast<std::size_t>(unknown_count_));
  for (const int node : nested_dissection(grid_.nx(), grid_.ny()))
    for (const int dof : {2 * node, 2 * node + 1})
      if (const int u = unknown_[static_cast<std::size_t>(dof)]; u >= 0) order.push_back(u);
  factor_.analyze(stiffness_, order);
}

void StripModel::number_unknowns(double window_width_m) {
  unknown_.assign(grid_.dofs(), 0);
  for (std::size_t i = 0; i < grid_.nx(); ++i) {
    const std::size_t bottom = grid_.node(i, grid_.ny() - 1);
    unknown_[2 * bottom] = unknown_[2 * bottom + 1] = kAtRest;
    if (grid_.x_m[i] < -kSlackM) first_column_ = i + 1;
    if (grid_.x_m[i] >= -kSlackM && grid_.x_m[i] <= window_width_m + kSlackM) {
      unknown_[2 * grid_.node(i, 0) + 1] = kPushed;
      last_column_ = i;
    }
  }
  for (int& u : unknown_)
    if (u == 0) u = unknown_count_++;
}

// The pattern of the stiffness, column by column: the unknowns of the nodes around; and where each element
// adds to it.
void StripModel::lay_out() {
  stiffness_.resize(unknown_count_, unknown_count_);
  stiffness_.reserve(Eigen::VectorXi::Constant(unknown_count_, 18));
  for (std::size_t j = 0; j < grid_.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = 0; i < grid_.nx(); ++i)
      for (const std::size_t own : {2 * grid_.node(i, j), 2 * grid_.node(i, j) + 1}) {
        if (unknown_[own] < 0) continue;
        for (std::size_t q = std::max<std::size_t>(j, 1) - 1; q < std::min(j + 2, grid_.ny()); ++q)
          for (std::size_t p = std::max<std::size_t>(i, 1) - 1; p < std::min(i + 2, grid_.nx()); ++p)
            for (const std::size_t other : {2 * grid_.node(p, q), 2 * grid_.node(p, q) + 1})
              if (unknown_[other] >= 0) stiffness_.insert(unknown_[other], unknown_[own]) = 0;
      }
  }
  check_cancelled();
  stiffness_.makeCompressed();
  slot_.reserve(64 * grid_.elements());
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const auto dofs = element_dofs(grid_, i, j);
      for (const std::size_t r : dofs)
        for (const std::size_t c : dofs) {
          const int row = unknown_[r], column = unknown_[c];
          slot_.push_back(row >= 0 && column >= 0
                              ? static_cast<int>(&stiffness_.coeffRef(row, column) - stiffness_.valuePtr())
                              : -1);
        }
    }
  }
}

// K_uu = sum E_e K_e and the load of the push (T4.6: K is linear in E).
void StripModel::fill(const std::vector<double>& youngs_modulus_pa) {
  std::fill_n(stiffness_.valuePtr(), stiffness_.nonZeros(), 0.0);
  load_.setZero(unknown_count_);
  const int* slot = slot_.data();
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const auto dofs = element_dofs(grid_, i, j);
      const double modulus = youngs_modulus_pa[grid_.element(i, j)];
      for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 8; ++c, ++slot) {
          const double k = modulus * element_[i](r, c);
          const int row = unknown_[dofs[static_cast<std::size_t>(r)]],
                    column = unknown_[dofs[static_cast<std::size_t>(c)]];
          if (*slot >= 0) stiffness_.valuePtr()[*slot] += k;
          if (row >= 0 && column == kPushed) load_[row] -= k;
        }
    }
  }
}

StripResponse StripModel::solve(const std::vector<double>& youngs_modulus_pa) {
  if (youngs_modulus_pa.size() != grid_.elements())
    throw std::invalid_argument("youngs_modulus_pa: one value per element of the strip");
  fill(youngs_modulus_pa);
  if (!factor_.factorize(stiffness_))
    throw std::domain_error("the stiffness of the strip under the probe is not positive definite");
  const Eigen::VectorXd unknowns = factor_.solve(load_);
  StripResponse out;
  out.displacement.resize(grid_.dofs());
  for (std::size_t d = 0; d < grid_.dofs(); ++d) {
    const int u = unknown_[d];
    out.displacement[d] = u >= 0 ? unknowns[u] : u == kPushed ? 1.0 : 0.0;
  }
  out.stress.resize(grid_.elements());
  const double height = grid_.y_m[1] - grid_.y_m[0];
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j) {
    check_cancelled();
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const auto dofs = element_dofs(grid_, i, j);
      const Vector8 u = gather(out.displacement, dofs);
      const double modulus = youngs_modulus_pa[grid_.element(i, j)];
      out.stress[grid_.element(i, j)] = modulus * (u[5] + u[7] - u[1] - u[3]) / (2 * height);
      out.force_n_per_m += modulus * u.dot(element_[i] * u);
    }
  }
  return out;
}

// The force is the least energy of all displacements with the push, so that its first change with the
// stiffness is u^T dK u, the displacement held.
double StripModel::log_force_slope(const StripResponse& homogeneous) const {
  const double step = kPoissonStep * (0.5 - stated_poisson_ratio_), height = grid_.y_m[1] - grid_.y_m[0];
  double change = 0;
  for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
    check_cancelled();
    const auto stiffness = [&](double nu) {
      const InPlaneStrain e = in_plane_strain(plane_, nu);
      return element_stiffness(grid_.x_m[i + 1] - grid_.x_m[i], height, e.modulus, e.poisson_ratio);
    };
    const Eigen::Matrix<double, 8, 8> difference =
        stiffness(stated_poisson_ratio_ + step) - stiffness(stated_poisson_ratio_ - step);
    for (std::size_t j = 0; j + 1 < grid_.ny(); ++j) {
      const Vector8 u = gather(homogeneous.displacement, element_dofs(grid_, i, j));
      change += u.dot(difference * u);
    }
  }
  return change / (2 * step) / homogeneous.force_n_per_m;
}

// The forces that a change of an element's modulus by `change_pa` adds: add(degree of freedom, force).
void StripModel::pull(const StripResponse& at, std::size_t element, double change_pa, auto&& add) const {
  const std::size_t i = element % (grid_.nx() - 1), j = element / (grid_.nx() - 1);
  const auto dofs = element_dofs(grid_, i, j);
  const Vector8 k = element_[i] * gather(at.displacement, dofs);
  for (int r = 0; r < 8; ++r) add(dofs[static_cast<std::size_t>(r)], -change_pa * k[r]);
}

std::vector<double> StripModel::change(const StripResponse& at, const std::vector<double>& change_pa) {
  std::vector<double> force(grid_.dofs(), 0.0);
  for (std::size_t e = 0; e < change_pa.size(); ++e) {
    if (e % kElementsAtOnce == 0) check_cancelled();
    if (change_pa[e] != 0) pull(at, e, change_pa[e], [&](std::size_t dof, double f) { force[dof] += f; });
  }
  return back_substituted(force);
}

std::vector<double> StripModel::sensitivity(const StripResponse& at, const std::vector<double>& load) {
  std::vector<double> out = products(back_substituted(load), at.displacement);
  for (double& product : out) product = -product;
  return out;
}

std::vector<double> StripModel::force_shares(const StripResponse& at,
                                             const std::vector<double>& youngs_modulus_pa) const {
  std::vector<double> out = products(at.displacement, at.displacement);
  for (std::size_t e = 0; e < out.size(); ++e) out[e] *= youngs_modulus_pa[e] / at.force_n_per_m;
  return out;
}

std::vector<double> StripModel::products(const std::vector<double>& a, const std::vector<double>& b) const {
  std::vector<double> out(grid_.elements());
  for (std::size_t e = 0; e < out.size(); ++e) {
    const std::size_t i = e % (grid_.nx() - 1), j = e / (grid_.nx() - 1);
    if (e % kElementsAtOnce == 0) check_cancelled();
    const auto dofs = element_dofs(grid_, i, j);
    out[e] = gather(a, dofs).dot(element_[i] * gather(b, dofs));
  }
  return out;
}

// K^-1 of the unknowns' part; 0 elsewhere.
std::vector<double> StripModel::back_substituted(const std::vector<double>& force) const {
  Eigen::VectorXd right(unknown_count_);
  for (std::size_t d = 0; d < force.size(); ++d)
    if (unknown_[d] >= 0) right[unknown_[d]] = force[d];
  const Eigen::VectorXd solved = factor_.solve(right);
  std::vector<double> out(force.size(), 0.0);
  for (std::size_t d = 0; d < force.size(); ++d)
    if (unknown_[d] >= 0) out[d] = solved[unknown_[d]];
  return out;
}

StripModel::NodeColumns StripModel::axial_changes(const StripResponse& at,
                                                  const std::vector<double>& youngs_modulus_pa,
                                                  const Groups& group_of, int groups) {
  using Columns = SparseFactor::Columns;
  constexpr int kAtOnce = Columns::ColsAtCompileTime;
  NodeColumns out = NodeColumns::Zero(static_cast<Eigen::Index>(grid_.nodes()), groups);
  for (int first = 0; first < groups; first += kAtOnce) {
    Columns force = Columns::Zero(unknown_count_, kAtOnce);
    for (std::size_t e = 0; e < grid_.elements(); ++e)
      if (const int column = group_of[e] - first; column >= 0 && column < kAtOnce)
        pull(at, e, youngs_modulus_pa[e], [&](std::size_t dof, double f) {
          if (const int u = unknown_[dof]; u >= 0) force(u, column) += f;
        });
    const Columns solved = factor_.solve_columns(force);
    const int count = std::min(kAtOnce, groups - first);
    for (std::size_t n = 0; n < grid_.nodes(); ++n)
      if (const int u = unknown_[2 * n + 1]; u >= 0)
        out.row(static_cast<Eigen::Index>(n)).segment(first, count) = solved.row(u).head(count);
  }
  return out;
}

StripCache::Entry::Entry(const TissueExtent& tissue, double window_width_m, Charge held)
    : charge(std::move(held)),
      model(tissue, window_width_m),
      homogeneous(model.solve(std::vector<double>(model.grid().elements(), 1.0))),
      log_force_slope(model.log_force_slope(homogeneous)) {}

// A model that stays until others need its room.
class StripCache::Kept final : public Reclaimable {
 public:
  Kept(const Key& key, std::shared_ptr<Entry> entry) : key_(key), entry_(std::move(entry)) {}
  const Key& key() const { return key_; }
  // Null once it was given back.
  std::shared_ptr<Entry> use() {
    const std::lock_guard lock(mutex_);
    used_ = use_stamp();
    return entry_;
  }
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override {
    const std::lock_guard lock(mutex_);  // never held for long
    if (entry_.use_count() != 1) return false;
    entry_.reset();
    return true;
  }

 private:
  const Key key_;
  std::atomic<std::uint64_t> used_ = use_stamp();
  std::mutex mutex_;
  std::shared_ptr<Entry> entry_;
};

bool StripCache::Key::same(const Key& k) const {
  return std::abs(k.window_x_m - window_x_m) < kSlackM && std::abs(k.right_m - right_m) < kSlackM &&
         k.depth_m == depth_m && k.poisson_ratio == poisson_ratio && k.width_m == width_m && k.plane == plane;
}

namespace {

// Memory of a model: its factor and its fronts, measured on strips of 5e3 to 2e5 unknowns, its matrix and
// where elements add to it; and what is needed for a moment to lay them out.
struct ModelBytes {
  std::uint64_t kept, making;
};
ModelBytes bytes_of(const TissueGrid& grid) {
  constexpr double kFactor = 66, kMatrix = 450, kTriplets = 512;  // per unknown; the first times log2
  const auto unknowns = static_cast<double>(grid.dofs());
  const auto kept = static_cast<std::uint64_t>(unknowns * (kFactor * std::log2(unknowns) + kMatrix));
  return {kept, kept + static_cast<std::uint64_t>(kTriplets * unknowns)};
}

}  // namespace

std::shared_ptr<StripCache::Entry> StripCache::get(const TissueExtent& tissue, double window_width_m) {
  const Surroundings c = surroundings(tissue, window_width_m);
  const Key key{tissue.window_x_m,    c.right_m,      tissue.depth_m,
                tissue.poisson_ratio, window_width_m, tissue.plane};
  const auto found =
      std::find_if(kept_.begin(), kept_.end(), [&](const auto& kept) { return kept->key().same(key); });
  if (found != kept_.end()) {
    if (auto entry = (*found)->use()) {
      kept_.splice(kept_.begin(), kept_, found);
      return entry;
    }
    kept_.erase(found);
  }
  const ModelBytes bytes = bytes_of(strip(c, tissue.depth_m, window_width_m));
  auto entry =
      std::make_shared<Entry>(tissue, window_width_m, account_.charge(Place::kHost, "strips", bytes.making));
  entry->charge.shrink(bytes.kept);
  kept_.push_front(std::make_shared<Kept>(key, entry));
  account_.add(Place::kHost, kept_.front());
  if (kept_.size() > kMax) kept_.pop_back();
  return entry;
}

}  // namespace teletact::service
