#include "bench/peers/patch_forward.h"

#include <algorithm>
#include <cmath>

#include "tests/reference/elasticity.h"

namespace teletact::bench {
namespace {

constexpr double kElementM = 1.5e-3, kPatchM = 3e-3, kCoarsestM = 6e-3, kGrowth = 1.4;

}  // namespace

PatchForward::PatchForward(const service::TissueExtent& tissue, double window_width_m,
                           double window_depth_m) {
  const double end_m = tissue.window_x_m + window_width_m;
  grid_.x_m = tissue.width_m > window_width_m * 1.001
                  ? service::graded_coordinates(0, tissue.width_m, tissue.window_x_m, end_m, kElementM,
                                                kCoarsestM, kGrowth)
                  : service::uniform_coordinates(
                        0, tissue.width_m, static_cast<std::size_t>(std::lround(tissue.width_m / kElementM)));
  grid_.y_m = service::uniform_coordinates(0, tissue.depth_m,
                                           static_cast<std::size_t>(std::lround(tissue.depth_m / kElementM)));
  hold(tissue, window_width_m);
  place(entries_of(tissue, window_width_m, window_depth_m));
  for (std::size_t j = 1; j + 1 < grid_.ny(); ++j)
    for (std::size_t i = 0; i < grid_.nx(); ++i) {
      const double x = grid_.x_m[i] - tissue.window_x_m;
      if (x < kElementM || x > window_width_m - kElementM || grid_.y_m[j] > window_depth_m - kElementM)
        continue;
      points_.push_back({x, grid_.y_m[j]});
      point_dof_.push_back(2 * grid_.node(i, j) + 1);
    }
}

double PatchForward::patch_m() const {
  return kPatchM;
}

std::vector<PatchForward::Entry> PatchForward::entries_of(const service::TissueExtent& tissue,
                                                          double window_width_m, double window_depth_m) {
  patches_x_ = static_cast<int>(std::ceil(window_width_m / kPatchM - 1e-9));
  patches_y_ = static_cast<int>(std::ceil(window_depth_m / kPatchM - 1e-9));
  std::vector<Entry> entries;
  for (std::size_t j = 0; j + 1 < grid_.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const double dx = grid_.x_m[i + 1] - grid_.x_m[i], dy = grid_.y_m[j + 1] - grid_.y_m[j];
      const double x = grid_.x_m[i] + dx / 2 - tissue.window_x_m, y = grid_.y_m[j] + dy / 2;
      const int px = std::clamp(static_cast<int>(std::floor(x / kPatchM)), 0, patches_x_ - 1),
                py = std::clamp(static_cast<int>(y / kPatchM), 0, patches_y_ - 1);
      const auto k = reference::element_matrix(dx, dy, 1.0, tissue.poisson_ratio,
                                               reference::Integration::kSelectiveReduced);
      const std::size_t nodes[] = {grid_.node(i, j), grid_.node(i + 1, j), grid_.node(i, j + 1),
                                   grid_.node(i + 1, j + 1)};
      const auto dof = [&](int a) { return static_cast<Eigen::Index>(2 * nodes[a / 2]) + a % 2; };
      for (int a = 0; a < 8; ++a)
        for (int b = 0; b < 8; ++b)
          entries.push_back({static_cast<std::size_t>(px + patches_x_ * py), dof(a), dof(b), k(a, b)});
    }
  return entries;
}

void PatchForward::hold(const service::TissueExtent& tissue, double window_width_m) {
  free_.assign(grid_.dofs(), 0);
  for (std::size_t i = 0; i < grid_.nx(); ++i) {
    const std::size_t bottom = grid_.node(i, grid_.ny() - 1);
    free_[2 * bottom] = free_[2 * bottom + 1] = -1;
    const double x = grid_.x_m[i] - tissue.window_x_m;
    if (x < -1e-9 || x > window_width_m + 1e-9) continue;
    face_.push_back(2 * grid_.node(i, 0) + 1);
    free_[face_.back()] = -1;
  }
  Eigen::Index count = 0;
  for (Eigen::Index& f : free_)
    if (f == 0) f = count++;
  stiffness_.resize(count, count);
}

void PatchForward::place(const std::vector<Entry>& entries) {
  std::vector<Eigen::Triplet<double>> pattern;
  const auto number = [&](Eigen::Index dof) { return free_[static_cast<std::size_t>(dof)]; };
  for (const Entry& e : entries)
    if (number(e.row) >= 0 && number(e.column) >= 0)
      pattern.emplace_back(static_cast<int>(number(e.row)), static_cast<int>(number(e.column)), e.value);
  stiffness_.setFromTriplets(pattern.begin(), pattern.end());
  factor_.analyzePattern(stiffness_);
  Eigen::VectorXd face = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(grid_.dofs()));
  for (const std::size_t f : face_) face[static_cast<Eigen::Index>(f)] = 1;
  patch_.assign(static_cast<std::size_t>(patches_x_ * patches_y_), {{}, Eigen::VectorXd::Zero(face.size())});
  for (const Entry& e : entries) {
    patch_[e.patch].pushed[e.row] += e.value * face[e.column];
    if (number(e.row) < 0 || number(e.column) < 0) continue;
    const double* value = &stiffness_.coeffRef(number(e.row), number(e.column));
    patch_[e.patch].entries.emplace_back(value - stiffness_.valuePtr(), e.value);
  }
}

std::vector<std::pair<std::size_t, std::size_t>> PatchForward::neighbours() const {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (int j = 0; j < patches_y_; ++j)
    for (int i = 0; i < patches_x_; ++i) {
      const auto n = static_cast<std::size_t>(i + patches_x_ * j);
      if (i + 1 < patches_x_) pairs.emplace_back(n, n + 1);
      if (j + 1 < patches_y_) pairs.emplace_back(n, n + static_cast<std::size_t>(patches_x_));
    }
  return pairs;
}

PatchForward::Response PatchForward::respond(const Eigen::VectorXd& modulus) {
  const auto dofs = static_cast<Eigen::Index>(grid_.dofs());
  std::fill(stiffness_.valuePtr(), stiffness_.valuePtr() + stiffness_.nonZeros(), 0.0);
  Eigen::VectorXd pushed = Eigen::VectorXd::Zero(dofs);  // K 1_face
  for (std::size_t p = 0; p < patch_.size(); ++p) {
    const double e = modulus[static_cast<Eigen::Index>(p)];
    for (const auto& [position, value] : patch_[p].entries) stiffness_.valuePtr()[position] += e * value;
    pushed += e * patch_[p].pushed;
  }
  factor_.factorize(stiffness_);
  Eigen::VectorXd load(stiffness_.rows()), u = Eigen::VectorXd::Zero(dofs);
  for (std::size_t d = 0; d < free_.size(); ++d)
    if (free_[d] >= 0) load[free_[d]] = -pushed[static_cast<Eigen::Index>(d)];
  const Eigen::VectorXd x = factor_.solve(load);
  for (std::size_t d = 0; d < free_.size(); ++d)
    if (free_[d] >= 0) u[static_cast<Eigen::Index>(d)] = x[free_[d]];
  for (const std::size_t f : face_) u[static_cast<Eigen::Index>(f)] = 1;
  Response out;
  out.axial.resize(static_cast<Eigen::Index>(points_.size()));
  for (std::size_t n = 0; n < points_.size(); ++n)
    out.axial[static_cast<Eigen::Index>(n)] = u[static_cast<Eigen::Index>(point_dof_[n])] - 1;
  out.force_n_per_m = pushed.dot(u);
  return out;
}

}  // namespace teletact::bench
