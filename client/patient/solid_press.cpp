#include "client/patient/solid_press.h"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <numeric>
#include <stdexcept>

namespace teletact::client {

namespace {

using Matrix = Eigen::SparseMatrix<double>;
using Index = Eigen::Index;

constexpr double kLeftOver = 1e-6;  // of the energy
constexpr std::size_t kRun = 10;
constexpr int kMaxSteps = 20000;
constexpr double kSmoothedSlide = 1e-3;  // of the push
constexpr int kMaxFrictionSteps = 30, kMaxContactSteps = 12;
constexpr double kFrictionSettled = 0.01;

// The lower triangle of K, no node held. Rows of a column are sorted as its neighbours are numbered.
Matrix stiffness(const SolidMesh& m) {
  const auto n = static_cast<Index>(3 * m.nodes());
  Matrix k(n, n);
  // Slot of each neighbour among those that are not before the node, -1 outside; 27 per node.
  std::vector<int> slots(27 * m.nodes(), -1);
  std::vector<int> rows;
  const auto neighbour = [&](std::size_t i, std::size_t lines, int by) {
    const auto at = static_cast<std::ptrdiff_t>(i) + by;
    return at >= 0 && at < static_cast<std::ptrdiff_t>(lines) ? at : -1;
  };
  for (std::size_t kz = 0; kz < m.nz(); ++kz)
    for (std::size_t i = 0; i < m.nx(); ++i)
      for (std::size_t j = 0; j < m.ny(); ++j) {
        const std::size_t node = m.node(i, j, kz);
        std::vector<std::size_t> after;
        for (int offset = 13; offset < 27; ++offset) {
          const auto a = neighbour(j, m.ny(), offset % 3 - 1), b = neighbour(i, m.nx(), offset / 3 % 3 - 1),
                     c = neighbour(kz, m.nz(), offset / 9 - 1);
          if (a < 0 || b < 0 || c < 0) continue;
          slots[27 * node + static_cast<std::size_t>(offset)] = static_cast<int>(after.size());
          after.push_back(
              m.node(static_cast<std::size_t>(b), static_cast<std::size_t>(a), static_cast<std::size_t>(c)));
        }
        for (std::size_t d = 0; d < 3; ++d) {
          k.outerIndexPtr()[3 * node + d] = static_cast<int>(rows.size());
          for (const std::size_t other : after)
            for (std::size_t e = 0; e < 3; ++e)
              if (other != node || e >= d) rows.push_back(static_cast<int>(3 * other + e));
        }
      }
  k.outerIndexPtr()[n] = static_cast<int>(rows.size());
  k.resizeNonZeros(static_cast<Index>(rows.size()));
  std::copy(rows.begin(), rows.end(), k.innerIndexPtr());
  std::fill_n(k.valuePtr(), rows.size(), 0.0);
  std::map<std::array<double, 3>, std::array<double, 576>> boxes;
  for (std::size_t kz = 0; kz + 1 < m.nz(); ++kz)
    for (std::size_t i = 0; i + 1 < m.nx(); ++i)
      for (std::size_t j = 0; j + 1 < m.ny(); ++j) {
        const std::array<double, 3> sides{m.x_m[i + 1] - m.x_m[i], m.y_m[j + 1] - m.y_m[j],
                                          m.z_m[kz + 1] - m.z_m[kz]};
        auto found = boxes.find(sides);
        if (found == boxes.end()) found = boxes.emplace(sides, box_stiffness(sides, m.poisson_ratio)).first;
        const auto& box = found->second;
        const double modulus = m.youngs_modulus_pa[m.element(i, j, kz)];
        for (std::size_t a = 0; a < 8; ++a) {
          const std::size_t column = m.node(i + a % 2, j + a / 2 % 2, kz + a / 4);
          for (std::size_t b = 0; b < 8; ++b) {
            const std::size_t row = m.node(i + b % 2, j + b / 2 % 2, kz + b / 4);
            if (row < column) continue;
            const std::size_t offset = 13 + 9 * (b / 4 - a / 4) + 3 * (b % 2 - a % 2) + b / 2 % 2 - a / 2 % 2;
            const int slot = slots[27 * column + offset];
            for (std::size_t d = 0; d < 3; ++d) {
              double* values = k.valuePtr() + k.outerIndexPtr()[3 * column + d];
              for (std::size_t e = row == column ? d : 0; e < 3; ++e)
                values[3 * slot + static_cast<int>(e) - static_cast<int>(d)] +=
                    modulus * box[24 * (3 * a + d) + 3 * b + e];
            }
          }
        }
      }
  return k;
}

// What is said of each unknown: held at a value, or a spring to where it was.
struct Condition {
  std::vector<char> held;
  Eigen::VectorXd value, spring;
  explicit Condition(std::size_t unknowns)
      : held(unknowns, 0), value(Eigen::VectorXd::Zero(static_cast<Index>(unknowns))), spring(value) {}
  void hold(std::size_t unknown, double at = 0) {
    held[unknown] = 1;
    value(static_cast<Index>(unknown)) = at;
  }
};

// Conjugate gradients on K u = f from u, whose energy u.K u is `energy`. Each step takes alpha rho of it
// (Hestenes and Stiefel 1952): it ends when a run of them took next to nothing of what is left.
void descend(const Matrix& k, const Eigen::VectorXd& f, double energy, Eigen::VectorXd& u) {
  const Eigen::IncompleteCholesky<double, Eigen::Lower, Eigen::NaturalOrdering<int>> factor(k);
  const auto lower = k.selfadjointView<Eigen::Lower>();
  Eigen::VectorXd r = f - lower * u, z = factor.solve(r), p = z, kp(u.size());
  double rho = r.dot(z);
  std::deque<double> run;
  for (int step = 0; step < kMaxSteps; ++step) {
    if (rho == 0) return;
    kp.noalias() = lower * p;
    const double alpha = rho / p.dot(kp);
    u += alpha * p;
    r -= alpha * kp;
    run.push_back(alpha * rho);
    energy -= run.back();
    if (run.size() > kRun) run.pop_front();
    if (run.size() == kRun && std::accumulate(run.begin(), run.end(), 0.0) <= kLeftOver * energy) return;
    z = factor.solve(r);
    const double next = r.dot(z);
    p = z + next / rho * p;
    rho = next;
  }
  throw std::runtime_error("the solid patient's equations were not solved");
}

// K u = 0 but for what is held; `u` is the first guess.
void solve(const Matrix& stiffness, const Condition& c, Eigen::VectorXd& u) {
  Matrix k = stiffness;
  Eigen::VectorXd f = Eigen::VectorXd::Zero(k.rows());
  for (Index column = 0; column < k.outerSize(); ++column)
    for (Matrix::InnerIterator entry(k, column); entry; ++entry) {
      const Index row = entry.row();
      const bool row_held = c.held[static_cast<std::size_t>(row)],
                 column_held = c.held[static_cast<std::size_t>(column)];
      if (row == column) {
        if (row_held)
          f(row) = entry.value() * c.value(row);
        else
          entry.valueRef() += c.spring(row);
        continue;
      }
      if (row_held && !column_held) f(column) -= entry.value() * c.value(row);
      if (column_held && !row_held) f(row) -= entry.value() * c.value(column);
      if (row_held || column_held) entry.valueRef() = 0;
    }
  k.prune(0.0);
  for (Index n = 0; n < u.size(); ++n)
    if (c.held[static_cast<std::size_t>(n)]) u(n) = c.value(n);
  const double energy =
      u.dot(stiffness.selfadjointView<Eigen::Lower>() * u) + u.dot(c.spring.cwiseProduct(u));
  descend(k, f, energy, u);
}

// A node under the face.
struct FaceNode {
  std::size_t node;
  double x_m;
};

class Press {
 public:
  Press(const Tissue& tissue, double window_x_m, double spacing_m, double window_z_m)
      : tissue_(tissue),
        solid_(*tissue.solid),
        middle_m_(window_x_m + tissue.probe.width_m / 2),
        plane_m_(window_z_m),
        mesh_(make_solid_mesh(tissue, window_x_m, spacing_m, window_z_m)),
        stiffness_(stiffness(mesh_)),
        u_(Eigen::VectorXd::Zero(stiffness_.rows())) {
    find_face(window_x_m);
    let_go_of_what_does_not_touch();
  }

  // The displacement; force() is then its.
  SolidField push(double compression_m) {
    Condition c = support();
    const bool stuck = std::isinf(solid_.friction);
    for (const FaceNode& n : face_) {
      c.hold(3 * n.node + 1, compression_m * (1 + solid_.uneven * from_middle(n.x_m)));
      if (stuck || solid_.friction > 0) c.hold(3 * n.node), c.hold(3 * n.node + 2);
    }
    guess(compression_m);
    solve(stiffness_, c, u_);
    if (!stuck && solid_.friction > 0) slide(c, compression_m);
    return {mesh_, {u_.begin(), u_.end()}};
  }

  double force_n() const {
    const Eigen::VectorXd f = reaction();
    double sum = 0;
    for (const FaceNode& n : face_) sum += f(static_cast<Index>(3 * n.node + 1));
    return mesh_.half ? 2 * sum : sum;
  }

 private:
  double from_middle(double x_m) const { return (x_m - middle_m_) / (tissue_.probe.width_m / 2); }
  Eigen::VectorXd reaction() const { return stiffness_.selfadjointView<Eigen::Lower>() * u_; }

  // Smooth, as deep as the tissue and somewhat wider than the face: a jump at its border would take long to
  // go.
  void guess(double compression_m) {
    constexpr double kBesideM = .01;
    for (std::size_t k = 0; k < mesh_.nz(); ++k)
      for (std::size_t i = 0; i < mesh_.nx(); ++i) {
        const double across = from_middle(mesh_.x_m[i]);
        const double beyond_m =
            std::hypot(std::max(0.0, std::abs(across) - 1) * tissue_.probe.width_m / 2,
                       std::max(0.0, std::abs(mesh_.z_m[k] - plane_m_) - tissue_.probe.elevation_m / 2));
        const double above = compression_m * (1 + solid_.uneven * std::clamp(across, -1.0, 1.0)) *
                             std::exp(-beyond_m / kBesideM);
        for (std::size_t j = 0; j < mesh_.ny(); ++j)
          u_(static_cast<Index>(3 * mesh_.node(i, j, k) + 1)) = above * (1 - mesh_.y_m[j] / mesh_.y_m.back());
      }
  }

  void find_face(double window_x_m) {
    const double slack = 1e-9;
    for (std::size_t k = 0; k < mesh_.nz(); ++k)
      for (std::size_t i = 0; i < mesh_.nx(); ++i) {
        const double x = mesh_.x_m[i], z = mesh_.z_m[k];
        if (x >= window_x_m - slack && x <= window_x_m + tissue_.probe.width_m + slack &&
            std::abs(z - plane_m_) <= tissue_.probe.elevation_m / 2 + slack)
          face_.push_back({mesh_.node(i, 0, k), x});
      }
  }

  // Bottom, image plane, and nothing that could drift.
  Condition support() const {
    Condition c(3 * mesh_.nodes());
    const bool slides = solid_.support == Support::kSliding;
    const std::size_t bottom = mesh_.ny() - 1;
    for (std::size_t k = 0; k < mesh_.nz(); ++k)
      for (std::size_t i = 0; i < mesh_.nx(); ++i) {
        const std::size_t node = mesh_.node(i, bottom, k);
        c.hold(3 * node + 1);
        if (!slides) c.hold(3 * node), c.hold(3 * node + 2);
      }
    if (mesh_.half)
      for (std::size_t n = 0; n < mesh_.nx() * mesh_.ny(); ++n) c.hold(3 * n + 2);
    if (slides && solid_.friction == 0) {
      const std::size_t x = mesh_.nx() / 2, z = mesh_.half ? 0 : mesh_.nz() / 2;
      c.hold(3 * mesh_.node(x, bottom, z));
      c.hold(3 * mesh_.node(x, bottom, z) + 2);
      c.hold(3 * mesh_.node(mesh_.nx() - 1, bottom, z) + 2);
    }
    return c;
  }

  // Frictionless contact under the preload: nodes that pull let go, nodes that the face reaches come back.
  void let_go_of_what_does_not_touch() {
    if (solid_.lean_m == 0) return;
    const auto depth_m = [&](const FaceNode& n) {
      return solid_.preload_m + solid_.lean_m * from_middle(n.x_m);
    };
    const std::vector<FaceNode> all = face_;
    std::vector<char> touches(all.size());
    for (std::size_t n = 0; n < all.size(); ++n) touches[n] = depth_m(all[n]) > 0;
    bool changed = true;
    for (int step = 0; changed && step < kMaxContactSteps; ++step) {
      Condition c = support();
      for (std::size_t n = 0; n < all.size(); ++n)
        if (touches[n]) c.hold(3 * all[n].node + 1, depth_m(all[n]));
      solve(stiffness_, c, u_);
      const Eigen::VectorXd f = reaction();
      changed = false;
      for (std::size_t n = 0; n < all.size(); ++n) {
        const auto y = static_cast<Index>(3 * all[n].node + 1);
        const bool should = touches[n] ? f(y) > 0 : u_(y) < depth_m(all[n]);
        changed = changed || should != static_cast<bool>(touches[n]);
        touches[n] = should;
      }
    }
    face_.clear();
    for (std::size_t n = 0; n < all.size(); ++n)
      if (touches[n]) face_.push_back(all[n]);
    u_.setZero();
  }

  // From stuck: springs along the face whose force is friction x pressure at the slide that they allow.
  void slide(Condition& c, double compression_m) {
    for (const FaceNode& n : face_)
      c.held[3 * n.node] = 0, c.held[3 * n.node + 2] = mesh_.half && on_plane(n);
    Eigen::VectorXd before = Eigen::VectorXd::Zero(u_.size());
    double changed = 1;
    for (int step = 0; changed > kFrictionSettled && step < kMaxFrictionSteps; ++step) {
      const Eigen::VectorXd f = reaction();
      for (const FaceNode& n : face_) {
        const auto x = static_cast<Index>(3 * n.node);
        const double slid = std::hypot(u_(x), u_(x + 2), kSmoothedSlide * compression_m);
        c.spring(x) = c.spring(x + 2) = solid_.friction * std::max(0.0, f(x + 1)) / slid;
      }
      before = u_;
      solve(stiffness_, c, u_);
      double moved = 0;
      for (const FaceNode& n : face_) {
        const auto x = static_cast<Index>(3 * n.node);
        moved = std::max(moved, std::hypot(u_(x) - before(x), u_(x + 2) - before(x + 2)));
      }
      changed = moved / compression_m;
    }
  }
  bool on_plane(const FaceNode& n) const { return n.node < mesh_.nx() * mesh_.ny(); }

  const Tissue& tissue_;
  const Solid& solid_;
  double middle_m_, plane_m_;
  SolidMesh mesh_;
  Matrix stiffness_;
  Eigen::VectorXd u_;
  std::vector<FaceNode> face_;
};

}  // namespace

ProbeState press_solid(const Tissue& tissue, double window_x_m, double compression_m, double spacing_m,
                       double window_z_m) {
  validate(tissue);
  if (!tissue.solid) throw TissueError("solid: the tissue is not solid; add [solid]");
  const Probe& probe = tissue.probe;
  const double slack = 1e-6 * probe.width_m;
  if (!(window_x_m >= -slack) || !(window_x_m + probe.width_m <= tissue.width_m + slack))
    throw std::invalid_argument(
        "window_x_m: the probe's face reaches beyond the tissue; choose 0 to width_m - probe.width_m");
  const double end_m = tissue.solid->elevational_width_m / 2;
  if (!(std::abs(window_z_m) + probe.elevation_m / 2 <= end_m + slack))
    throw std::invalid_argument(
        "window_z_m: the probe's face reaches beyond the tissue's ends; choose at most "
        "(solid.elevational_width_m - probe.elevation_m) / 2 to either side");
  if (!(compression_m > 0) || !(compression_m <= .1 * tissue.depth_m))
    throw std::invalid_argument("compression_m: must be more than 0 and at most a tenth of the depth");
  window_x_m = std::clamp(window_x_m, 0.0, tissue.width_m - probe.width_m);
  Press press(tissue, window_x_m, spacing_m, window_z_m);
  ProbeState state;
  state.window_x_m = window_x_m;
  state.window_z_m = window_z_m;
  state.width_m = probe.width_m;
  state.compression_m = compression_m;
  state.tilt = tissue.solid->uneven * compression_m / (probe.width_m / 2);
  state.field = std::make_shared<SolidField>(press.push(compression_m));
  state.force_n = press.force_n();
  state.contact_area_m2 = probe.contact_area_m2();
  return state;
}

}  // namespace teletact::client
