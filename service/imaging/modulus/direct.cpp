// The direct modulus (T3.2) in five steps: reference stress (T3.1) -> forward solve with it -> strain on the
// nodes, axial slopes measured, lateral ones from the forward solve -> adjoint-weighted equation -> scale by
// the force. Then again from the forward solve on, with the map so found.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/imaging/modulus/direct_equation.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/seed.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

// A correction that asks for a larger one than the first, or for no number, is not taken. One that asks for
// more than this part of the first (.93 where the tissue moves as no plane strain does, .59 to .79 where an
// inclusion goes on beside the window; .3 to .57 of phantoms), or for more than the one before, is the last.
constexpr double kContracts = 0.6;
// The equation may give anything where the strain says little: of mu over the background's.
constexpr double kMin = 0.05, kMax = 50;
constexpr double kMinStrainSize = 0.03;  // sqrt |det A| over its median
constexpr double kStreaks = 0.01;        // part of the window without a modulus from which on it is said

class Direct : public ModulusMethod {
 public:
  Direct(Queue queue, DirectOptions options, std::shared_ptr<StripCache> strips)
      : options_(options),
        strips_(std::move(strips)),
        // The corrections of the direct map take the place of its own.
        reference_(make_reference_stress(std::move(queue), {.corrections = 0}, strips_)) {}

  ModulusEstimate estimate(const ModulusInput& in) override {
    const ModulusEstimate reference = in.reference ? *in.reference : reference_->estimate(in);
    const auto strip = strips_->get(in.tissue, in.window_width_m);
    StripModel& model = strip->model;
    const WindowNodes nodes(model);
    const AxialSlopes slopes = axial_slopes(nodes, in.measured);
    const auto map_from = [&](const Eigen::VectorXd& log_modulus, double background) {
      Map map{reference, 0, {}};
      map.estimate.background = background;
      solve(in, model, nodes, slopes, log_modulus, map);
      map.log_modulus = shrunk_log_modulus(model, in, map.estimate);
      return map;
    };
    const Eigen::VectorXd start = shrunk_log_modulus(model, in, reference);
    Map map = map_from(start, reference.background);
    const double first = rms_under_probe(model, map.log_modulus - start);
    double change = first;
    bool contracts = true;
    for (int n = 0; n < options_.max_corrections && contracts && change >= options_.settled; ++n) {
      Map next = map_from(map.log_modulus, map.estimate.background);
      const double then = rms_under_probe(model, next.log_modulus - map.log_modulus);
      if (!(then <= first)) break;
      contracts = then <= kContracts * first && then < change;
      map = std::move(next);
      change = then;
    }
    if (static_cast<double>(map.streaks) > kStreaks * static_cast<double>(nodes.size()))
      map.estimate.warn(ModulusFlag::kStreaks,
                        "{} % of the window is hardly strained or gave no positive modulus: it has no "
                        "modulus there, and streaks may cross what is beside it",
                        100 * map.streaks / nodes.size());
    return std::move(map.estimate);
  }

 private:
  struct Map {
    ModulusEstimate estimate;
    std::size_t streaks = 0;      // nodes without a modulus
    Eigen::VectorXd log_modulus;  // for the next forward solve
  };

  // The map of the forward solve with `log_modulus` into `map`, which holds the background that it is
  // relative to, and says something where the reference stress does.
  void solve(const ModulusInput& in, StripModel& model, const WindowNodes& nodes, const AxialSlopes& slopes,
             const Eigen::VectorXd& log_modulus, Map& map) const {
    ModulusEstimate& out = map.estimate;
    const ForwardSolve forward = solve_forward(model, log_modulus, out.background, slopes);
    const DirectProblem problem = problem_of(in.tissue, nodes, slopes, forward);
    DirectSolution solution = solved(nodes, problem);
    for (double& mu : solution.shear_modulus) mu /= mu_per_e(in.tissue);
    map.streaks = leave_out_undetermined(problem, out.background, solution.shear_modulus);
    out.kind = ModulusKind::kDirect;
    out.converged = solution.residual < 1e-6;
    out.youngs_modulus =
        scaled(nodes.on_image(solution.shear_modulus, in.measured.grid),
               force_scale(in, forward.response.force_n_per_m, forward.amplitude_m), out.youngs_modulus);
    normalise(out);
  }

  static DirectSolution solved(const WindowNodes& nodes, const DirectProblem& problem) {
    try {
      return solve_direct(nodes, problem);
    } catch (const std::domain_error& error) {
      throw NoCompression(std::string("the strain determines no modulus (") + error.what() +
                          "): press further between the frames");
    }
  }

  static double mu_per_e(const TissueExtent& tissue) { return 0.5 / (1 + tissue.poisson_ratio); }

  // Border, lateral derivatives and change of volume are the forward solve's, du_y/dx and du_y/dy measured.
  static DirectProblem problem_of(const TissueExtent& tissue, const WindowNodes& nodes,
                                  const AxialSlopes& slopes, const ForwardSolve& forward) {
    DirectProblem p;
    p.plane = tissue.plane;
    const ModelState& state = forward.state;
    const double a = forward.amplitude_m, nu = tissue.poisson_ratio;
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      p.shear_modulus.push_back(std::exp(state.log_modulus[n]) * mu_per_e(tissue));
      const double volume = a * (state.lateral[n] + state.along[n]);
      p.half_pressure.push_back(0.5 * (a * state.pressure[n] - p.shear_modulus.back() * volume));
      const bool measured = slopes.measured[n];
      const double yy = measured ? slopes.along[n] : a * state.along[n];
      const double across = measured ? slopes.across[n] : a * state.across[n];
      p.xy.push_back(a * (state.shear[n] - 0.5 * state.across[n]) + 0.5 * across);
      if (p.plane == Plane::kStrain) {
        p.yy.push_back(yy - 0.5 * volume);
        p.xx.push_back(-p.yy.back());
        continue;
      }
      // eps_xx / eps_yy as modelled, but never beyond what an incompressible solid may show.
      const double ratio = std::clamp(state.lateral[n] / state.along[n], -1.0, 1.0);
      const double trace = nu / (1 - nu) * (1 + ratio) * yy;
      p.xx.push_back(ratio * yy + trace);
      p.yy.push_back(yy + trace);
    }
    return p;
  }

  // Where the strain hardly determines the modulus (det A near 0) or what came out is no modulus, nothing is
  // said. How many nodes that is.
  static std::size_t leave_out_undetermined(const DirectProblem& problem, double background,
                                            std::vector<double>& modulus) {
    const std::vector<double> size = strain_size(problem);
    std::vector<double> any_order = size;
    const double least = kMinStrainSize * median(any_order);
    std::size_t streaks = 0;
    for (std::size_t n = 0; n < modulus.size(); ++n) {
      if (size[n] >= least && modulus[n] >= kMin * background && modulus[n] <= kMax * background) continue;
      modulus[n] = std::numeric_limits<double>::quiet_NaN();
      ++streaks;
    }
    return streaks;
  }

  // `map` in the unit of the force, where the reference stress says something.
  static Field scaled(Field map, double scale, const Field& reference) {
    for (std::size_t n = 0; n < map.size(); ++n)
      map[n] = std::isfinite(reference[n]) ? static_cast<float>(scale) * map[n]
                                           : std::numeric_limits<float>::quiet_NaN();
    return map;
  }

  // The factor of grad mu: sqrt |det A_mu| / 2.
  static std::vector<double> strain_size(const DirectProblem& p) {
    std::vector<double> size(p.yy.size());
    for (std::size_t n = 0; n < size.size(); ++n)
      size[n] = std::sqrt(std::abs(p.xx[n] * p.yy[n] - p.xy[n] * p.xy[n]));
    return size;
  }

  DirectOptions options_;
  std::shared_ptr<StripCache> strips_;
  std::unique_ptr<ModulusMethod> reference_;
};

}  // namespace

std::unique_ptr<ModulusMethod> make_direct(Queue queue, DirectOptions options,
                                           std::shared_ptr<StripCache> strips) {
  return std::make_unique<Direct>(std::move(queue), options, std::move(strips));
}

}  // namespace teletact::service
