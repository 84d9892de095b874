#include "client/patient/patient.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <random>
#include <stdexcept>

namespace teletact::client {

namespace {

Tissue validated(Tissue tissue) {
  validate(tissue);
  if (tissue.solid)
    throw TissueError(
        "solid: this patient is of plane tissue; take [solid] out, or acquire it with --slices");
  return tissue;
}

}  // namespace

Patient::Patient(Tissue tissue, double spacing_m)
    : tissue_(validated(std::move(tissue))),
      mesh_(make_mesh(tissue_, spacing_m)),
      solver_(mesh_),
      compliance_(solver_.surface_compliance()) {}

ProbeState Patient::press(double window_x_m, double compression_m) const {
  const Probe& probe = tissue_.probe;
  const double slack = 1e-6 * probe.width_m;
  if (!(window_x_m >= -slack) || !(window_x_m + probe.width_m <= tissue_.width_m + slack))
    throw std::invalid_argument(
        "window_x_m: the probe's face reaches beyond the tissue; choose 0 to width_m - probe.width_m");
  if (!(compression_m > 0) || !(compression_m <= .1 * tissue_.depth_m))
    throw std::invalid_argument("compression_m: must be more than 0 and at most a tenth of the depth");
  Eigen::Index begin = 0, end = 0;  // surface nodes under the face
  for (const double x : mesh_.x_m) {
    if (x < window_x_m - slack) ++begin;
    if (x <= window_x_m + probe.width_m + slack) ++end;
  }
  // S_pp lambda = w (T4.2), then K u = B^T lambda
  const Eigen::Index count = end - begin;
  const Eigen::VectorXd w = Eigen::VectorXd::Constant(count, compression_m);
  Eigen::VectorXd force = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(mesh_.nx()));
  force.segment(begin, count) = compliance_.block(begin, begin, count, count).llt().solve(w);
  ProbeState state;
  state.window_x_m = window_x_m;
  state.width_m = probe.width_m;
  state.compression_m = compression_m;
  state.force_n = force.sum() * probe.elevation_m;
  state.contact_area_m2 = probe.contact_area_m2();
  state.field = std::make_shared<PlaneField>(mesh_, solver_.displacement(force));
  return state;
}

double sensed_force(const Probe& probe, double true_force_n, std::uint64_t seed) {
  std::mt19937_64 random(seed ^ 0x5E4507F0ACE00000u);
  std::normal_distribution<double> normal;
  const double relative = probe.force_noise_relative * normal(random);
  const double shown_n = true_force_n * (1 + probe.force_gain_error) + probe.force_zero_n;
  return shown_n + true_force_n * relative + probe.force_noise_n * normal(random);
}

}  // namespace teletact::client
