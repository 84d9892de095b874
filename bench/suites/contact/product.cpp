// Figures of ours that have no rival: all touchable layers, the window's tissue that the service makes,
// tangent, work around a closed loop, ripple between nodes, and conjugate gradients under a moving finger.
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>

#include "bench/basics/clock.h"
#include "bench/suites/contact/contact.h"
#include "service/base/choices.h"
#include "service/scene/tissue_models.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

using service::ContactAnswer;
using service::PlanePose;
using service::TissueModel;

TissueModel model_of(const reference::TouchedTissue& t) {
  return {t.grid, t.material, t.supports, {.thickness_m = t.thickness_m}};
}

// The surface alone, and a model that foresees touches below it with all of its layers; processor time.
LayerFigures measure_layers(const ContactProblem& p, int repeats) {
  std::vector<double> surface_s, all_s;
  const auto build = [&](bool interior_layers) {
    const TissueModel model(p.tissue.grid, p.tissue.material, p.tissue.supports,
                            {.interior_layers = interior_layers});
    for (std::size_t row = 1; interior_layers && row + 1 < p.tissue.grid.ny(); ++row) model.compliance(row);
  };
  for (int k = 0; k < repeats; ++k) {
    surface_s.push_back(processor_seconds_of([&] { build(false); }));
    all_s.push_back(processor_seconds_of([&] { build(true); }));
  }
  return {quantiles(surface_s), quantiles(all_s)};
}

// A window of 60 mm in tissue wide enough that its tissue for touch has all of its context on both sides: its
// model as the service makes it, and made again when the tissue right of the window has changed. Both must be
// equal.
WindowTissueFigures measure_window_tissue(int repeats) {
  service::SceneGeometry geometry;
  geometry.width_m = 0.260;
  geometry.depth_m = 0.040;
  constexpr double kBeginM = 0.100, kEndM = 0.160;
  const service::TissueGrid grid{service::window_columns_m(geometry, kBeginM, kEndM),
                                 service::window_rows_m(geometry)};
  service::Material material{std::vector<double>(grid.elements(), 10e3), geometry.poisson_ratio};
  for (std::size_t e = 0; e < grid.elements(); e += 7) material.youngs_modulus_pa[e] = 100e3;
  const double reach_m = service::choices::kHandOver + service::choices::kWidestReach;
  const service::TissueModelOptions options{
      .touch_begin_m = kBeginM - reach_m, .touch_end_m = kEndM + reach_m, .will_change = true};
  const TissueModel before(grid, material, geometry.supports, options);
  service::Material changed = material;
  for (std::size_t e = 0; e < grid.elements(); ++e)
    if (grid.x_m[e % (grid.nx() - 1) + 1] > kEndM) changed.youngs_modulus_pa[e] *= 2;
  std::vector<double> ready_s, refreshed_s;
  double difference = 0;
  for (int k = 0; k < repeats; ++k) {
    std::optional<TissueModel> anew, follows;
    ready_s.push_back(processor_seconds_of([&] { anew.emplace(grid, changed, geometry.supports, options); }));
    refreshed_s.push_back(
        processor_seconds_of([&] { follows.emplace(grid, changed, geometry.supports, options, &before); }));
    const std::array nodes{before.problem().touchable.first, grid.nx() / 2, before.problem().touchable.last};
    difference = std::max(difference, (anew->compliance(0)->among(nodes, nullptr) -
                                       follows->compliance(0)->among(nodes, nullptr))
                                          .cwiseAbs()
                                          .maxCoeff());
  }
  return {grid.nx(), grid.ny(), quantiles(ready_s), quantiles(refreshed_s), difference};
}

// Largest difference of the tangent from the central difference of the force, over the largest entry.
double tangent_error(const ContactProblem& p, const TissueModel& model) {
  constexpr double kStepM = 1e-7;
  const auto at = [&](double dx, double dy) {
    return service::solve_contact(model.problem(), 0, *model.compliance(0), p.tip,
                                  {p.pose.x_m + dx, p.pose.indentation_m + dy});
  };
  const auto tangent = at(0, 0).tangent_n_m;
  const std::array<ContactAnswer, 4> moved{at(kStepM, 0), at(-kStepM, 0), at(0, kStepM), at(0, -kStepM)};
  double worst = 0, scale = 0;
  for (const double entry : tangent) scale = std::max(scale, std::abs(entry));
  for (std::size_t row = 0; row < 2; ++row)
    for (std::size_t column = 0; column < 2; ++column) {
      const double slope =
          (moved[2 * column].force_n[row] - moved[2 * column + 1].force_n[row]) / (2 * kStepM);
      worst = std::max(worst, std::abs(slope - tangent[3 * row + column]) / scale);
    }
  return worst;
}

// Work of the force around press, slide, release and back above the tissue, over the energy moved:
// trapezoidal rule with its end-point correction by the tangent.
double loop_work(const ContactProblem& p, const TissueModel& model, int steps) {
  constexpr double kSlideM = 0.010;
  const double x0 = p.pose.x_m - kSlideM / 2, x1 = p.pose.x_m + kSlideM / 2, deep = p.pose.indentation_m;
  double work = 0, energy = 0;
  const auto leg = [&](PlanePose from, PlanePose to) {
    const double hx = (to.x_m - from.x_m) / steps, hy = (to.indentation_m - from.indentation_m) / steps;
    const auto along = [&](const ContactAnswer& a) {  // power, and its slope along the leg
      return std::array{
          a.force_n[0] * hx + a.force_n[1] * hy,
          a.tangent_n_m[0] * hx * hx + 2 * a.tangent_n_m[1] * hx * hy + a.tangent_n_m[4] * hy * hy};
    };
    std::array<double, 2> last{};
    for (int k = 0; k <= steps; ++k) {
      const ContactAnswer a = service::solve_contact(model.problem(), 0, *model.compliance(0), p.tip,
                                                     {from.x_m + k * hx, from.indentation_m + k * hy});
      const auto now = along(a);
      if (k > 0) work += (last[0] + now[0]) / 2 + (last[1] - now[1]) / 12;
      last = now;
      energy = std::max(energy, a.energy_j);
    }
  };
  leg({x0, 0}, {x0, deep});
  leg({x0, deep}, {x1, deep});
  leg({x1, deep}, {x1, 0});
  return std::abs(work) / energy;
}

// Spread of the stiffness over its mean while the finger moves from one node to the next, 2 mm deep in
// homogeneous tissue: of force over indentation, and of the tangent.
Ripple measure_ripple(const ContactProblem& p) {
  constexpr int kPoses = 64;
  constexpr double kDepthM = 0.002;
  ContactCase homogeneous = p.of;
  homogeneous.contrast = 1;
  const TissueModel model = model_of(make_tissue(homogeneous));
  const double spacing_m = p.tissue.grid.x_m[1], middle_m = p.tissue.grid.x_m[p.tissue.grid.nx() / 2];
  std::array<double, 2> least{1e300, 1e300}, most{}, sum{};
  for (int k = 0; k < kPoses; ++k) {
    const ContactAnswer a = service::solve_contact(model.problem(), 0, *model.compliance(0), p.tip,
                                                   {middle_m + spacing_m * k / kPoses, kDepthM});
    const std::array stiffness{-a.force_n[1] / kDepthM, -a.tangent_n_m[4]};
    for (std::size_t s = 0; s < 2; ++s) {
      least[s] = std::min(least[s], stiffness[s]);
      most[s] = std::max(most[s], stiffness[s]);
      sum[s] += stiffness[s] / kPoses;
    }
  }
  return {(most[0] - least[0]) / sum[0], (most[1] - least[1]) / sum[1]};
}

// Notices columns that were not asked for before: what conjugate gradients solve for.
class Watched final : public service::Compliance {
 public:
  explicit Watched(std::shared_ptr<service::Compliance> of) : of_(std::move(of)) {}
  Eigen::MatrixXd among(std::span<const std::size_t> nodes, service::SolveReport* report) override {
    note(nodes);
    return of_->among(nodes, report);
  }
  Eigen::MatrixXd axial_among(std::span<const std::size_t> nodes, service::SolveReport* report) override {
    note(nodes);
    return of_->axial_among(nodes, report);
  }
  std::optional<service::FormError> error_between(std::span<const std::size_t> unknowns,
                                                  const Eigen::MatrixX2d& left,
                                                  const Eigen::VectorXd& right) const override {
    return of_->error_between(unknowns, left, right);
  }
  std::size_t known() const { return known_.size(); }

 private:
  void note(std::span<const std::size_t> nodes) { known_.insert(nodes.begin(), nodes.end()); }
  std::shared_ptr<service::Compliance> of_;
  std::set<std::size_t> known_;
};

// Compliance columns by conjugate gradients, asked for as the finger moves 10 mm at 120 mm/s, 1000 poses/s:
// the columns that the patch gains are solved for, the others kept. Most poses gain none.
PathFigures measure_path(const ContactProblem& p, const std::shared_ptr<service::Device>& device) {
  constexpr double kStepM = 0.120 / 1000;
  constexpr int kPoses = 83;
  const TissueModel model = model_of(p.tissue);
  std::optional<Watched> compliance;
  const double begin_m = p.pose.x_m - kStepM * kPoses / 2;
  const auto touch = [&](int k) {
    return service::solve_contact(model.problem(), 0, *compliance, p.tip,
                                  {begin_m + k * kStepM, p.pose.indentation_m});
  };
  const double patch_s = seconds_of([&] {
    compliance.emplace(model.compliance(0, device));
    touch(0);
  });
  double spent_s = 0, worst = 0;
  std::vector<double> seconds, solving;  // of all poses; of those that solve for a column
  for (int k = 1; k <= kPoses; ++k) {
    ContactAnswer a;
    const std::size_t known = compliance->known();
    seconds.push_back(seconds_of([&] { a = touch(k); }));
    spent_s += seconds.back();
    if (compliance->known() > known) solving.push_back(seconds.back());
    const ContactAnswer exact = service::solve_contact(model.problem(), 0, *model.compliance(0), p.tip,
                                                       {begin_m + k * kStepM, p.pose.indentation_m});
    worst = std::max(worst, std::hypot(a.force_n[0] - exact.force_n[0], a.force_n[1] - exact.force_n[1]) /
                                std::hypot(exact.force_n[0], exact.force_n[1]));
  }
  return {patch_s, spent_s / kPoses, quantiles(seconds), quantiles(solving), worst};
}

}  // namespace

ColumnFigures measure_columns(const ContactProblem& p, const std::shared_ptr<service::Device>& device) try {
  const TissueModel model = model_of(p.tissue);
  const ContactAnswer a =
      service::solve_contact(model.problem(), 0, *model.compliance(0, device), p.tip, p.pose);
  const double error = p.force_error({a.force_n[0], a.force_n[1]});
  std::printf("  columns by the product's PCG: %zu iterations, force off by %.1e, stated %.1e%s\n",
              a.solve.iterations, error, a.solve.relative_error, a.solve.converged ? "" : "  NOT CONVERGED");
  return {"", a.solve.iterations, a.solve.converged, a.solve.relative_error, error};
} catch (const std::runtime_error& error) {  // a breakdown is a result
  return {error.what()};
}

ProductFigures measure_product(const ContactProblem& base, const std::shared_ptr<service::Device>& device,
                               bool quick) {
  const TissueModel model = model_of(base.tissue);
  const int repeats = quick ? 3 : 11;
  return {measure_layers(base, quick ? 2 : 5),
          measure_window_tissue(repeats),
          tangent_error(base, model),
          loop_work(base, model, quick ? 1000 : 4000),
          measure_ripple(base),
          measure_path(base, device)};
}

}  // namespace teletact::bench
