#include "bench/suites/plan/models.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>
#include <vector>

#include "bench/basics/clock.h"
#include "service/base/planner.h"

namespace teletact::bench {
namespace {

constexpr service::Fingertip kTip;  // rounded, 8 mm
constexpr double kConverged = 1e-5;
constexpr double kNearM = 7e-4;  // along x and z

double all_processor_ms(auto&& work) {
  return 1e3 * processor_seconds_of(work, CLOCK_PROCESS_CPUTIME_ID);
}

// What is too quick for the clock, many times over.
PlanAnswer timed(std::string model, double converged_n, auto&& force_n) {
  constexpr int kTimes = 100;
  PlanAnswer out{.model = std::move(model), .converged_n = converged_n};
  out.ms = all_processor_ms([&] {
             for (int n = 0; n < kTimes; ++n) out.force_n = force_n();
           }) /
           kTimes;
  return out;
}

service::SolidTissue homogeneous(const PlanScene& scene) {
  service::SolidTissue tissue = scene.tissue(1);
  tissue.youngs_modulus_pa.assign(tissue.grid.elements(), kPlanModulusPa);
  return tissue;
}

// Its E0, layer by layer.
service::LayerStack layers_of(const service::SolidTissue& tissue) {
  return {std::vector(tissue.grid.layers(), kVoxelM), service::layered(tissue).youngs_modulus_pa,
          tissue.poisson_ratio};
}

// The modulus at one z everywhere.
service::SolidTissue extruded(service::SolidTissue tissue, std::size_t slice) {
  const std::size_t nx = tissue.grid.nx, nz = tissue.grid.nz;
  std::vector<double>& e = tissue.youngs_modulus_pa;
  for (std::size_t n = 0; n < e.size(); ++n) e[n] = e[n % nx + nx * (slice + nz * (n / (nx * nz)))];
  return tissue;
}

// Plane strain of an extruded tissue: one element along z, of 1 m.
service::SolidTissue plane_of(const service::SolidTissue& extruded) {
  service::SolidTissue plane = extruded;
  const std::size_t nx = extruded.grid.nx;
  plane.grid.nz = 1, plane.grid.spacing_z_m = 1;
  plane.youngs_modulus_pa.clear();
  for (std::size_t n = 0; n < nx * extruded.grid.layers(); ++n)
    plane.youngs_modulus_pa.push_back(
        extruded.youngs_modulus_pa[n % nx + extruded.grid.columns() * (n / nx)]);
  return plane;
}

}  // namespace

auto PlanModels::layer_of(const PlanScene& scene) -> Layer& {
  auto& layer = layers_[{scene.poisson_ratio, scene.depth_m, scene.nx}];
  if (!layer) {
    const service::SolidTissue tissue = homogeneous(scene);
    layer = std::make_unique<Layer>(
        Layer{service::LayeredTouch({{scene.depth_m}, {1}, scene.poisson_ratio}, kTip),
              std::make_unique<RigidContact>(queue_, plane_of(tissue))});
  }
  return *layer;
}

auto PlanModels::learned(Contact& contact) const -> Learned {
  std::mutex solving;
  const auto learn_ms = [&](Contact& of) {
    return all_processor_ms([&] { of.learn_shares(queue_, solving); });
  };
  const double both_ms = learn_ms(contact);
  Contact other(queue_, contact, contact.tissue());  // another slice has the same factor
  Learned out;
  out.slice_ms = learn_ms(other), out.fields_ms = both_ms - out.slice_ms;
  service::Fingertip tip = kTip;
  tip.radius_m *= 0.99;  // that nobody touched with
  out.tip_ms = all_processor_ms([&] { contact.shares(tip); });
  return out;
}

auto PlanModels::enter(const PlanScene& scene, bool learn_fine) -> Ready {
  scene_ = &scene;
  layer_ = &layer_of(scene);
  const service::SolidTissue tissue = scene.tissue(1), halved = scene.tissue(2);
  exact_.emplace(queue_, tissue);
  if (!offered_) fine_exact_.emplace(queue_, halved);
  Ready ready;
  // With the closed form of their layers.
  const service::Vector3 any = in_block({.indentation_m = 0.002});
  ready.m3_ms = all_processor_ms([&] { coarse_.emplace(queue_, tissue).felt_answer(kTip, any); });
  ready.coarse = learned(*coarse_);
  shares_ = coarse_->shares(kTip);
  layer_pa_ = felt_modulus_pa();
  layers_touch_.emplace(layers_of(tissue), kTip);
  if (offered_ && !learn_fine) return ready;
  ready.m4_ms = all_processor_ms([&] { fine_.emplace(queue_, halved).felt_answer(kTip, any); });
  if (learn_fine) ready.fine = learned(*fine_);
  return ready;
}

service::Vector3 PlanModels::in_block(const PlanPose& pose) const {
  return {double(scene_->nx) * kVoxelM / 2 + pose.x_m, pose.indentation_m,
          double(scene_->nz) * kVoxelM / 2 + pose.z_m};
}

double PlanModels::exact_n(const PlanPose& pose, double modulus_pa) const {
  return layer_->touch.at(pose.indentation_m).times(modulus_pa).force_n;
}
double PlanModels::layer_n(const PlanPose& pose) const {
  return exact_n(pose, layer_pa_);
}

// As shares feel it about each node, as deep as the poses of a finger are.
double PlanModels::felt_modulus_pa() const {
  double least = HUGE_VAL, most = -HUGE_VAL;  // ln E
  for (const double d : {0.0003, 0.001, 0.002, 0.004, 0.008}) {
    const double unit_n = exact_n({.indentation_m = d}, 1);
    for (std::size_t k = 0; k < scene_->nz; ++k)
      for (std::size_t i = 0; i < scene_->nx; ++i) {
        const double force_n = -shares_->answer({double(i) * kVoxelM, d, double(k) * kVoxelM}).force_n[1];
        least = std::min(least, std::log(force_n / unit_n)),
        most = std::max(most, std::log(force_n / unit_n));
      }
  }
  return std::exp((least + most) / 2);
}

void PlanModels::answer_of_slice(const PlanPose& pose, double converged_n, std::vector<PlanAnswer>& out) {
  const service::SolidTissue slice = extruded(coarse_->tissue(), std::size_t(in_block(pose)[2] / kVoxelM));
  const auto once = [&](const char* model, auto&& force_n) {
    PlanAnswer& a = out.emplace_back(PlanAnswer{.model = model, .converged_n = converged_n});
    a.ms = all_processor_ms([&] { a.force_n = force_n(); });
  };
  RigidContact plane(queue_, plane_of(slice));
  const double thickness_m =
      exact_n(pose, kPlanModulusPa) / layer_->plane->force_n(pose.x_m, 0, pose.indentation_m);
  once("plane", [&] { return thickness_m * plane.force_n(pose.x_m, 0, pose.indentation_m); });
  Contact contact(queue_, slice);
  contact.felt_answer(kTip, in_block(pose));  // its layers' closed form
  once("extruded", [&] {
    contact.touch(kTip, in_block(pose));
    return -contact.felt_answer(kTip, in_block(pose)).force_n[1];
  });
}

void PlanModels::answer_by(const Contact& contact, double converged_n, const PlanPose& pose,
                           const std::string& model, double before_ms, std::vector<PlanAnswer>& out) const {
  service::ContactAnswer a;
  const double ms = before_ms + all_processor_ms([&] { a = contact.felt_answer(kTip, in_block(pose)); });
  out.push_back({model, -a.force_n[1], ms, a.solve.relative_error, converged_n, linear_half_width(a.budget)});
}

void PlanModels::answer_corrected(const Contact& felt, double converged_n, const PlanPose& pose,
                                  const std::string& name, std::vector<PlanAnswer>& out) const {
  Contact contact(felt, 0);
  contact.feel();
  const double ms = all_processor_ms([&] { contact.touch(kTip, in_block(pose)); });
  answer_by(contact, converged_n, pose, name, ms, out);
}

void PlanModels::answer_on(const Contact& felt, double converged_n, const PlanPose& pose,
                           const std::string& name, const char* guess,
                           const std::vector<std::size_t>& iterations, std::vector<PlanAnswer>& out) const {
  const service::Vector3 at = in_block(pose);
  answer_by(felt, converged_n, pose, guess, 0, out);
  for (const std::size_t k : iterations) {
    Contact contact(felt, 0);
    contact.feel();
    const double ms = all_processor_ms([&] { contact.correct(kTip, at, 0, k); });
    answer_by(contact, converged_n, pose, fmt::format("{} {}", name, k), ms, out);
  }
  Contact near(felt, 0);
  near.correct(kTip, {at[0] + kNearM, at[1], at[2] + kNearM});
  answer_by(near, converged_n, pose, name + " near", 0, out);
  answer_corrected(felt, converged_n, pose, name, out);
}

void PlanModels::answer_planned(double converged_n, const PlanPose& pose,
                                std::vector<PlanAnswer>& out) const {
  const service::Vector3 at = in_block(pose);
  for (const double share : kPlanTolerances) {
    const service::Tolerance tolerance{share, kPlanFloor * share};
    bool by_shares = false;
    service::ContactAnswer a;
    PlanAnswer answer = timed(fmt::format("planned {:.0f} %", 100 * share), converged_n, [&] {
      const double over = shares_->over(at, tolerance, service::FiniteStrain::kLeftOut);
      by_shares = service::Planner().takes_shares(over, service::Planner::Clock::now());
      if (by_shares) a = shares_->answer(at);
      return -a.force_n[1];
    });
    if (!by_shares) {
      Contact contact(*coarse_, 0);
      contact.feel();
      answer.ms += all_processor_ms([&] {
        contact.touch(kTip, at);
        a = contact.felt_answer(kTip, at);
      });
    }
    answer.force_n = -a.force_n[1];
    answer.budget = linear_half_width(a.budget);
    answer.by = by_shares ? "M1" : "M3";
    out.push_back(answer);
  }
}

std::vector<PlanAnswer> PlanModels::at(const PlanPose& pose) {
  const service::Vector3 at = in_block(pose);
  const auto converge = [&](service::SolidContact<double>& exact) {
    exact.touch(kTip, at, {.force_error = kConverged});
    return -exact.felt_answer(kTip, at).force_n[1];
  };
  const double converged_n = converge(*exact_), nodes_n = -exact_->answer(kTip, at).force_n[1];
  std::vector<PlanAnswer> out;
  out.push_back(timed("M0", converged_n, [&] { return layer_n(pose); }));
  out.push_back(timed("M2", converged_n, [&] { return layers_touch_->at(pose.indentation_m).force_n; }));
  service::ContactAnswer a;
  out.push_back(timed("M1", converged_n, [&] {
    a = shares_->answer(at);
    return -a.force_n[1];
  }));
  out.back().budget = linear_half_width(a.budget);
  if (offered_) {
    answer_corrected(*coarse_, converged_n, pose, "M3", out);
    answer_planned(converged_n, pose, out);
    return out;
  }
  answer_of_slice(pose, converged_n, out);
  out.push_back({"M3 nodes", nodes_n, 0, 0, nodes_n});
  const std::size_t nodes = out.size() - 1;
  answer_on(*coarse_, converged_n, pose, "M3", "G", {1, 2, 4, 8}, out);
  out[nodes].ms = out.back().ms;
  answer_planned(converged_n, pose, out);
  answer_on(*fine_, converge(*fine_exact_), pose, "M4", "G 1 mm", {2, 8}, out);
  return out;
}

}  // namespace teletact::bench
