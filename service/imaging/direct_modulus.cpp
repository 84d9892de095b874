// The direct modulus (T3.2) in five steps: reference stress (T3.1) -> forward solve with it -> strain on the
// nodes, axial slopes measured, lateral ones from the forward solve -> adjoint-weighted equation -> scale by
// the force.
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/imaging/direct_equation.h"
#include "service/imaging/modulus.h"
#include "service/imaging/modulus_seed.h"

namespace teletact::service {
namespace {

// The equation may give anything where the strain says little: of mu over the background's.
constexpr double kLeastPoissonRatio = 0.45;  // of plane strain: below, lateral strain is not -axial
constexpr double kLeast = 0.05, kMost = 50;
constexpr double kLeastStrain = 0.03;  // sqrt |det A| over its median
constexpr double kStreaks = 0.01;      // part of the window without a modulus from which on it is said

class Direct : public ModulusMethod {
 public:
  Direct(Queue queue, DirectOptions options, std::shared_ptr<StripCache> strips)
      : queue_(std::move(queue)),
        options_(options),
        strips_(strips ? std::move(strips) : std::make_shared<StripCache>()) {
    if (!(options_.background_below >= 0 && options_.full_above > options_.background_below))
      throw std::invalid_argument("background_below, full_above: must be 0 or more, and the second larger");
    if (!(options_.stabilisation >= 0)) throw std::invalid_argument("stabilisation: must be 0 or more");
    ReferenceStressOptions reference;
    reference.corrections = options_.seed_corrections;
    reference_ = make_reference_stress(queue_, reference, strips_);
  }

  ModulusEstimate estimate(const ModulusInput& in) override {
    ModulusEstimate out = reference_->estimate(in);
    out.kind = ModulusKind::kDirect;
    const auto strip = strips_->get(in.tissue, in.window_width_m);
    const WindowNodes nodes(strip->model);
    const AxialSlopes slopes = axial_slopes(nodes, in.grid, queue_.read(in.displacement.field_m),
                                            queue_.read(in.displacement.trusted), options_.reach);
    const ForwardSolve forward =
        solve_forward(strip->model, in, out, slopes, {options_.background_below, options_.full_above});
    DirectProblem problem = strain_of(in.tissue, nodes, slopes, forward);
    problem.stabilisation = options_.stabilisation;
    const double half_per_e = 0.5 / (1 + in.tissue.poisson_ratio);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      problem.shear_modulus.push_back(std::exp(forward.state.log_modulus[n]) * half_per_e);
      problem.half_pressure.push_back(0.5 * forward.amplitude_m * forward.state.pressure[n]);
    }
    DirectSolution solution = solved(nodes, problem);
    out.converged = solution.residual < 1e-6;
    for (double& mu : solution.shear_modulus) mu /= half_per_e;
    publish(in, nodes, problem, forward, std::move(solution.shear_modulus), out);
    if (in.tissue.plane == Plane::kStrain && in.tissue.poisson_ratio < kLeastPoissonRatio)
      out.warnings.push_back(
          {ModulusFlag::kCompressible,
           "the direct modulus takes plane strain to be incompressible, and the Poisson ratio is "
           "below 0.45: use the iterative or the reference-stress method"});
    return out;
  }

 private:
  static DirectSolution solved(const WindowNodes& nodes, const DirectProblem& problem) {
    try {
      return solve_direct(nodes, problem);
    } catch (const std::domain_error& error) {
      throw NoCompression(std::string("the strain determines no modulus (") + error.what() +
                          "): press further between the frames");
    }
  }

  // Axial strain measured; the lateral derivatives that it cannot give from the forward solve.
  DirectProblem strain_of(const TissueExtent& tissue, const WindowNodes& nodes, const AxialSlopes& slopes,
                          const ForwardSolve& forward) const {
    DirectProblem p;
    p.plane = tissue.plane;
    const ModelState& state = forward.state;
    const double a = forward.amplitude_m, nu = tissue.poisson_ratio;
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      const bool measured = slopes.measured[n];
      const double yy = measured ? slopes.along[n] : a * state.along[n];
      const double across = measured ? slopes.across[n] : a * state.across[n];
      p.xy.push_back(a * (state.shear[n] - 0.5 * state.across[n]) + 0.5 * across);
      if (p.plane == Plane::kStrain) {
        p.xx.push_back(-yy);
        p.yy.push_back(yy);
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
  // said; elsewhere the map takes the scale of the force.
  void publish(const ModulusInput& in, const WindowNodes& nodes, const DirectProblem& problem,
               const ForwardSolve& forward, std::vector<double> modulus, ModulusEstimate& out) const {
    const std::vector<double> size = strain_size(problem);
    std::vector<double> sorted = size;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                     sorted.end());
    const double least = kLeastStrain * sorted[sorted.size() / 2];
    std::size_t streaks = 0;
    for (std::size_t n = 0; n < modulus.size(); ++n) {
      if (size[n] >= least && modulus[n] >= kLeast * out.background && modulus[n] <= kMost * out.background)
        continue;
      modulus[n] = std::numeric_limits<double>::quiet_NaN();
      ++streaks;
    }
    if (static_cast<double>(streaks) > kStreaks * static_cast<double>(modulus.size()))
      out.warnings.push_back(
          {ModulusFlag::kStreaks,
           std::to_string(100 * streaks / modulus.size()) +
               " % of the window is hardly strained or gave no positive modulus: nothing is "
               "said there, and streaks may cross what is beside it"});
    const double scale = force_scale(in, forward);
    const Field map = nodes.on_image(modulus, in.grid);
    for (std::size_t n = 0; n < map.size(); ++n)
      if (std::isfinite(out.youngs_modulus[n])) out.youngs_modulus[n] = static_cast<float>(scale) * map[n];
    normalise(out);
  }

  // What multiplies grad mu: sqrt |det A_mu| / 2.
  static std::vector<double> strain_size(const DirectProblem& p) {
    std::vector<double> size(p.yy.size());
    for (std::size_t n = 0; n < size.size(); ++n)
      size[n] = std::sqrt(std::abs(p.xx[n] * p.yy[n] - p.xy[n] * p.xy[n]));
    return size;
  }

  Queue queue_;
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
