#include "bench/suites/plan/models.h"

#include <fmt/format.h>

#include <cmath>

#include "bench/basics/clock.h"
#include "service/solid/solid_solver.h"

namespace teletact::bench {
namespace {

constexpr service::Fingertip kTip;  // rounded, 8 mm
constexpr double kConverged = 1e-5;
constexpr double kNearM = 7e-4;  // along x and z

// Timed; what is too quick for the clock many times over.
PlanAnswer timed(std::string model, double spacing_m, auto&& force_n, int times = 1) {
  PlanAnswer out{.model = std::move(model), .spacing_m = spacing_m};
  out.ms = 1e3 / times *
           processor_seconds_of(
               [&] {
                 for (int n = 0; n < times; ++n) out.force_n = force_n();
               },
               CLOCK_PROCESS_CPUTIME_ID);
  return out;
}

service::SolidTissue homogeneous(const PlanScene& scene) {
  service::SolidTissue tissue = scene.tissue(1);
  tissue.youngs_modulus_pa.assign(tissue.grid.elements(), kPlanModulusPa);
  return tissue;
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

service::EnergyShares shares_of(const service::Queue& queue, const service::SolidTissue& tissue) {
  service::SolidSolver<double> solver(queue, tissue);
  const auto load = service::EnergyShares::usual_load(tissue.grid);
  solver.load(load.unknowns, load.force_n, {.relative_error = HUGE_VAL, .max_iterations = 0});
  return {queue, tissue.grid, solver.layers(), tissue.poisson_ratio, solver.displacement()};
}

}  // namespace

auto PlanModels::layer_of(const PlanScene& scene) -> Layer& {
  auto& layer = layers_[{scene.poisson_ratio, scene.depth_m, scene.nx}];
  if (!layer) {
    const service::SolidTissue tissue = homogeneous(scene);
    layer.reset(new Layer{service::LayerTouch(scene.poisson_ratio), Contact(queue_, tissue),
                          shares_of(queue_, tissue),
                          std::make_unique<RigidContact>(queue_, plane_of(tissue))});
  }
  return *layer;
}

void PlanModels::enter(const PlanScene& scene) {
  scene_ = &scene;
  layer_ = &layer_of(scene);
  const service::SolidTissue tissue = scene.tissue(1);
  felt_ln_ = -2 * layer_->shares.felt(tissue).scale.array().log() + std::log(kPlanModulusPa);
  mean_pa_ = std::exp(felt_ln_.mean());
  coarse_.emplace(queue_, tissue);
  layered_.emplace(*coarse_, 0);
  fine_.emplace(queue_, scene.tissue(2));
  exact_.emplace(queue_, tissue);
}

service::Vector3 PlanModels::in_block(const PlanPose& pose) const {
  return {double(scene_->nx) * kVoxelM / 2 + pose.x_m, pose.indentation_m,
          double(scene_->nz) * kVoxelM / 2 + pose.z_m};
}

// Between the four nodes around.
double PlanModels::felt_pa(const PlanPose& pose) const {
  const service::Vector3 at = in_block(pose);
  const double x = at[0] / kVoxelM, z = at[2] / kVoxelM;
  const auto i = std::size_t(x), k = std::size_t(z);
  const auto ln = [&](std::size_t a, std::size_t b) {
    return felt_ln_[Eigen::Index((i + a) % scene_->nx + scene_->nx * ((k + b) % scene_->nz))];
  };
  const double u = x - double(i), v = z - double(k);
  return std::exp((1 - v) * ((1 - u) * ln(0, 0) + u * ln(1, 0)) + v * ((1 - u) * ln(0, 1) + u * ln(1, 1)));
}

double PlanModels::layer_n(const PlanPose& pose) const {
  return layer_->touch.touch(mean_pa_, scene_->depth_m, kTip.radius_m, pose.indentation_m).force_n;
}

double PlanModels::mesh_share(const PlanPose& pose) const {
  return -layer_->nodes.answer(kTip, in_block(pose)).force_n[1] /
         layer_->touch.touch(kPlanModulusPa, scene_->depth_m, kTip.radius_m, pose.indentation_m).force_n;
}

double PlanModels::converged_n(const PlanPose& pose) {
  return -exact_->touch(kTip, in_block(pose), {.force_error = kConverged}).force_n[1];
}

double PlanModels::answer_on(const Contact& felt, const PlanPose& pose, const char* guess,
                             const std::string& corrected, const std::vector<std::size_t>& iterations,
                             std::vector<PlanAnswer>& out) const {
  const service::Vector3 at = in_block(pose);
  const auto add = [&](const std::string& model, auto&& answered) {
    service::ContactAnswer answer;
    out.push_back(timed(model, felt.tissue().grid.spacing_x_m, [&] {
      answer = answered();
      return -answer.force_n[1];
    }));
    out.back().stated = answer.solve.relative_error;
  };
  add(guess, [&] { return felt.answer(kTip, at); });
  for (const std::size_t k : iterations) {
    Contact contact(felt, 0);
    contact.feel();
    add(fmt::format("{} {}", corrected, k), [&] {
      contact.correct(kTip, at, 0, k);
      return contact.answer(kTip, at);
    });
  }
  Contact contact(felt, 0), near(felt, 0);
  contact.feel();
  add(corrected, [&] { return contact.touch(kTip, at); });
  near.correct(kTip, {at[0] + kNearM, at[1], at[2] + kNearM});
  add(corrected + " near", [&] { return near.answer(kTip, at); });
  return -contact.touch(kTip, at, {.force_error = kConverged}).force_n[1];
}

void PlanModels::answer_of_slice(const PlanPose& pose, std::vector<PlanAnswer>& out) {
  const service::SolidTissue slice = extruded(coarse_->tissue(), std::size_t(in_block(pose)[2] / kVoxelM));
  RigidContact plane(queue_, plane_of(slice));
  const double thickness_m =
      layer_->touch.touch(kPlanModulusPa, scene_->depth_m, kTip.radius_m, pose.indentation_m).force_n /
      layer_->plane->force_n(pose.x_m, 0, pose.indentation_m);
  out.push_back(
      timed("plane", 0, [&] { return thickness_m * plane.force_n(pose.x_m, 0, pose.indentation_m); }));
  Contact contact(queue_, slice);
  out.push_back(timed("extruded", kVoxelM, [&] { return -contact.touch(kTip, in_block(pose)).force_n[1]; }));
}

std::vector<PlanAnswer> PlanModels::at(const PlanPose& pose) {
  constexpr int kTimes = 100;
  std::vector<PlanAnswer> out;
  const auto closed_n = [&](double modulus_pa) {
    return layer_->touch.touch(modulus_pa, scene_->depth_m, kTip.radius_m, pose.indentation_m).force_n;
  };
  out.push_back(timed(
      "M0", 0, [&] { return closed_n(mean_pa_); }, kTimes));
  out.push_back(timed(
      "M0 felt", 0, [&] { return closed_n(felt_pa(pose)); }, kTimes));
  // M1, log-weighted shares of the force over M2, goes here.
  out.push_back(timed("M2", kVoxelM, [&] { return -layered_->answer(kTip, in_block(pose)).force_n[1]; }));
  answer_of_slice(pose, out);
  answer_on(*coarse_, pose, "G", "M3", {1, 2, 4, 8}, out);
  fine_converged_n_ = answer_on(*fine_, pose, "G 1 mm", "M4", {2, 8}, out);
  return out;
}

}  // namespace teletact::bench
