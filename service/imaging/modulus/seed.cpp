#include "service/imaging/modulus/seed.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

// Part of the median modelled strain below which a node does not vote on the amplitude.
constexpr double kMinReached = 0.5;
// |log(E / background)| below the first is background, above the second it counts fully, between linearly.
constexpr double kBackgroundBelow = 0.35, kFullAbove = 0.4;

double amplitude(const ModelState& state, const AxialSlopes& slopes) {
  std::vector<double> modelled = state.along, ratios;
  const double typical = std::abs(median(modelled));
  for (std::size_t n = 0; n < state.along.size(); ++n)
    if (slopes.measured[n] && std::abs(state.along[n]) >= kMinReached * typical)
      ratios.push_back(slopes.along[n] / state.along[n]);
  if (ratios.empty())
    throw NoCompression("no node of the displacement can be trusted inside the tissue; check depth_m");
  return median(ratios);
}

}  // namespace

double mean_strain(std::vector<float> trusted_axial_strain) {
  if (trusted_axial_strain.empty())
    throw NoCompression("no node of the strain map can be trusted inside the tissue; check depth_m");
  const double mean = median(trusted_axial_strain);
  if (!(std::abs(mean) >= kMinStrain))
    throw NoCompression(fmt::format(
        "the median axial strain is {:.3g} %, less than {:.3g} %: press further between the frames",
        100 * mean, 100 * kMinStrain));
  return mean;
}

Eigen::VectorXd shrunk_log_modulus(const StripModel& model, const ModulusInput& in,
                                   const ModulusEstimate& map) {
  const std::vector<double> e = model.on_elements(map.youngs_modulus, in.measured.grid, map.background,
                                                  map.absolute ? in.known : kNothingKnown);
  Eigen::VectorXd out(static_cast<Eigen::Index>(e.size()));
  for (std::size_t k = 0; k < e.size(); ++k) {
    const double logarithm = std::log(e[k] / map.background), size = std::abs(logarithm);
    const double kept = size >= kFullAbove ? size
                        : size <= kBackgroundBelow
                            ? 0
                            : kFullAbove * (size - kBackgroundBelow) / (kFullAbove - kBackgroundBelow);
    out[static_cast<Eigen::Index>(k)] = std::copysign(kept, logarithm);
  }
  return out;
}

double rms_under_probe(const StripModel& model, const Eigen::VectorXd& of_elements) {
  const std::size_t columns = model.grid().nx() - 1;
  double sum = 0, count = 0;
  for (Eigen::Index e = 0; e < of_elements.size(); ++e) {
    const std::size_t i = static_cast<std::size_t>(e) % columns;
    if (i >= model.first_column() && i < model.last_column()) sum += of_elements[e] * of_elements[e], ++count;
  }
  return std::sqrt(sum / count);
}

ForwardSolve solve_forward(StripModel& model, const Eigen::VectorXd& log_modulus, double background,
                           const AxialSlopes& slopes) {
  std::vector<double> e(static_cast<std::size_t>(log_modulus.size()));
  for (std::size_t k = 0; k < e.size(); ++k)
    e[k] = background * std::exp(log_modulus[static_cast<Eigen::Index>(k)]);
  ForwardSolve out;
  out.response = model.solve(e);
  out.state = model_state(model, out.response, e);
  out.amplitude_m = amplitude(out.state, slopes);
  return out;
}

double force_scale(const ModulusInput& in, double modelled_n_per_m, double amplitude_m) {
  if (!in.force) return 1;
  const double force_n_per_m = in.force->force_n / in.force->contact_area_m2 * in.window_width_m;
  return force_n_per_m / (modelled_n_per_m * std::abs(amplitude_m));
}

void validate(const std::optional<ProbeForce>& force) {
  if (!force) return;
  if (!(force->force_n > 0 && std::isfinite(force->force_n)))
    throw std::invalid_argument(
        "force_n: must be above 0 N, the rise of the probe's force between pre and post");
  if (!(force->contact_area_m2 > 0 && std::isfinite(force->contact_area_m2)))
    throw std::invalid_argument("contact_area_m2: must be above 0 m2, the probe's face on the tissue");
}

void normalise(ModulusEstimate& out) {
  std::vector<float> said;
  for (const float e : out.youngs_modulus)
    if (std::isfinite(e)) said.push_back(e);
  if (said.empty())
    throw NoCompression("no node of the modulus map can be trusted; press further between the frames");
  out.background = median(said);
  if (out.absolute) return;
  for (float& e : out.youngs_modulus) e /= static_cast<float>(out.background);
  out.background = 1;
}

}  // namespace teletact::service
