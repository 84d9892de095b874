#include "bench/rigid_contact.h"

#include <Eigen/Cholesky>

#include "service/base/choices.h"

namespace teletact::bench {
namespace {

// Certified, of the energy norm; and what a correction may change the force by so that the next one need not
// be made: it leaves its square.
constexpr double kError = 5e-4, kLastChange = 3e-3;
constexpr int kMaxCorrections = 12;

std::size_t around(long n, std::size_t period) {
  const auto size = static_cast<long>(period);
  return static_cast<std::size_t>((n % size + size) % size);
}

}  // namespace

double linear_half_width(const service::ForceBudget& budget) {
  service::ForceBudget linear;
  for (const service::ForceError& e : budget.terms())
    if (e.term != service::ErrorTerm::kFiniteStrain) linear.add(e);
  return linear.half_width();
}

std::size_t surface_unknown(const service::SolidGrid& grid, long i, long k, std::size_t c) {
  return around(i, grid.nx) + grid.nx * (around(k, grid.nz) + grid.nz * c);
}

SurfaceValues paraboloid_push(const service::SolidGrid& grid, double x_m, double z_m, double indentation_m) {
  SurfaceValues push;
  std::vector<double> depths;
  for (std::size_t k = 0; k < grid.nz; ++k)
    for (std::size_t i = 0; i < grid.nx; ++i) {
      const double away = std::hypot((double(i) - double(grid.nx / 2)) * grid.spacing_x_m - x_m,
                                     (double(k) - double(grid.nz / 2)) * grid.spacing_z_m - z_m);
      const double overlap = indentation_m - away * away / (2 * kTipRadiusM);
      if (overlap <= 0) continue;
      push.unknowns.push_back(surface_unknown(grid, long(i), long(k), 1));
      depths.push_back(overlap);
    }
  push.values = Eigen::Map<Eigen::VectorXd>(depths.data(), Eigen::Index(depths.size()));
  return push;
}

RigidPress press_rigid(const Eigen::MatrixXd& s, const Eigen::VectorXd& overlap_m) {
  RigidPress out;
  out.active = settled(overlap_m, [&](const std::vector<Eigen::Index>& active) -> Pressed {
    out.force_n = Eigen::MatrixXd(s(active, active)).llt().solve(Eigen::VectorXd(overlap_m(active)));
    return {out.force_n, s(Eigen::all, active) * out.force_n};
  });
  return out;
}

RigidContact::RigidContact(const service::Queue& queue, const service::SolidTissue& tissue)
    : grid_(tissue.grid),
      solver_(queue, tissue),
      wide_(service::wide_surface(grid_, solver_.layers(), tissue.poisson_ratio,
                                  service::choices::kMinPeriod * grid_.y_m.back())),
      known_(grid_, solver_.layers(), 1, 1, wide_, wide_, solver_.row()->layered) {}

double RigidContact::force_n(double x_m, double z_m, double indentation_m) {
  const SurfaceValues all = paraboloid_push(grid_, x_m, z_m, indentation_m);
  if (all.unknowns.empty()) throw BenchError("a rigid tip touches no node");
  const bool layered = solver_.layers().largest - solver_.layers().least < 1e-9;
  double before = 0;
  for (int corrections = 0; corrections <= kMaxCorrections; ++corrections) {
    const RigidPress press = press_rigid(known_.among(all.unknowns), all.values);
    const double force = press.force_n.sum();
    if (layered || std::abs(force - before) <= kLastChange * force) return force;
    before = force;
    service::SurfacePatch patch{{}, Eigen::VectorXd::Zero(press.force_n.size())};
    for (const Eigen::Index n : press.active) patch.unknowns.push_back(all.unknowns[std::size_t(n)]);
    const auto solved =
        solver_.push(patch, all.values(press.active) - known_.wider_m(patch.unknowns, press.force_n),
                     {.relative_error = kError + 2 * solver_.rounding(), .max_iterations = 1000});
    if (solved.reason != service::StopReason::kConverged)
      throw BenchError("a rigid contact does not converge");
    known_.add(patch.unknowns, solved.force_n, solver_.excess());
  }
  throw BenchError("a rigid contact does not settle");
}

}  // namespace teletact::bench
