// The modulus by ours and others' methods from the same displacement; 1 % compression, 30 dB, rho 0.99, a
// probe of 60 mm in the middle of tissue 160 mm wide.
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

#include "bench/basics/clock.h"
#include "bench/peers/modulus_peer.h"
#include "bench/suites/elastography/elastography.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {
namespace {

constexpr double kTissueWidthM = 0.160;
constexpr std::uint64_t kSeeds = 20, kQuickSeeds = 2;
constexpr std::uint64_t kSlowSeeds = 2;    // of a peer that takes seconds
constexpr double kStrainKernelM = 2.0e-3;  // of 1/strain

// One phantom, tracked by ours; what every method starts from.
struct Tracked {
  Phantom phantom;
  service::Measured measured;
  Track track;
  double displacement_s = 0, strain_s = 0, window_width_m = 0;
};

struct Method {
  std::string name;
  bool ours = false;
  std::uint64_t max_seeds = kSeeds;
  std::function<std::vector<float>(const Tracked&)> estimate;
};

class Imaging {
 public:
  explicit Imaging(const std::shared_ptr<service::Device>& device)
      : queue_(device->queue()), displacement_(queue_, {}), strain_(queue_, {}) {}

  Tracked track(Phantom p) {
    Tracked t;
    auto begin = Clock::now();
    const service::DisplacementEstimate displacement = displacement_.estimate(p.pre, p.post, p.geometry);
    service::Measured& m = t.measured;
    m.grid = service::image_grid(displacement.grid, p.geometry);
    service::download(queue_, displacement, m);
    t.displacement_s = seconds_since(begin);
    begin = Clock::now();
    service::download(queue_, strain_.estimate(displacement, m.grid), m);
    t.strain_s = seconds_since(begin);
    t.track.grid = m.grid;
    t.track.axial_m.assign(m.axial_displacement.begin(), m.axial_displacement.end());
    t.track.lateral_m.assign(m.lateral_displacement.begin(), m.lateral_displacement.end());
    t.track.valid = m.displacement_valid;
    t.window_width_m = static_cast<double>(p.pre.line_count) * p.geometry.line_pitch_m;
    t.phantom = std::move(p);
    return t;
  }

  const service::Queue& queue() const { return queue_; }

 private:
  service::Queue queue_;
  service::DisplacementEstimator displacement_;
  service::StrainEstimator strain_;
};

Method ours(const std::string& name, std::shared_ptr<service::ModulusMethod> method) {
  return {name, true, kSeeds, [method](const Tracked& t) {
            const service::ProbeForce force{t.phantom.sensed_force_n, t.phantom.contact_area_m2};
            return method->estimate({t.measured, t.window_width_m, t.phantom.tissue, force}).youngs_modulus;
          }};
}

Method theirs(const ModulusPeer& peer, std::uint64_t max_seeds) {
  return {peer.name, false, max_seeds, [peer](const Tracked& t) {
            const std::vector<double> strain = axial_strain(t.track, kStrainKernelM, kKernelLateralM);
            return peer.estimate({t.track,
                                  strain,
                                  t.window_width_m,
                                  t.phantom.tissue.depth_m,
                                  t.phantom.tissue,
                                  {t.phantom.sensed_force_n, t.phantom.contact_area_m2}});
          }};
}

std::vector<Method> methods(const service::Queue& queue) {
  std::vector<Method> all;
  const auto strips = std::make_shared<service::StripCache>();
  all.push_back(ours("ours, reference stress", service::make_reference_stress(queue, {}, strips)));
  all.push_back(ours("ours, direct", service::make_direct(queue, {}, strips)));
  all.push_back(ours("ours, iterative", service::make_iterative(queue, strips)));
  all.push_back(theirs(make_inverse_strain(), kSeeds));
  all.push_back(theirs(make_gauss_newton(), kSlowSeeds));
  return all;
}

std::vector<PhantomCase> cases(bool quick) {
  std::vector<PhantomCase> all;
  for (const double diameter_m : quick ? std::vector{10e-3} : std::vector{8e-3, 15e-3})
    for (const double contrast : quick ? std::vector{3.0, 10.0} : std::vector{2.0, 3.0, 5.0, 10.0})
      all.push_back({.contrast = contrast, .diameter_m = diameter_m, .tissue_width_m = kTissueWidthM});
  return all;
}

// What a method made of one phantom.
struct Answer {
  std::vector<float> modulus;  // empty: it broke down
  std::string failed;
  double seconds = 0;
};

Answer ask(const Method& method, const Tracked& t) {
  Answer a;
  const auto begin = Clock::now();
  try {
    a.modulus = method.estimate(t);
  } catch (const std::exception& error) {  // a method that breaks down is a result
    a.failed = error.what();
  }
  a.seconds = seconds_since(begin);
  return a;
}

ModulusSeed judge(const Tracked& t, const Answer& answer, const std::vector<std::uint8_t>& judged) {
  if (answer.modulus.empty()) return {answer.failed};
  return {{},
          answer.seconds,
          t.displacement_s,
          t.strain_s,
          modulus_quality(answer.modulus, t.track.grid, t.phantom, judged)};
}

void measure_seed(const Tracked& t, const std::vector<Method>& all, std::uint64_t seed, bool quick,
                  std::vector<ModulusMethodFigures>& rows) {
  std::map<std::size_t, Answer> answers;
  std::vector<std::vector<float>> maps;
  for (std::size_t m = 0; m < all.size(); ++m) {
    if (seed > (quick && all[m].max_seeds < kSeeds ? 1 : all[m].max_seeds)) continue;
    if (seed == 1 && all[m].ours) ask(all[m], t);  // a first launch compiles
    answers[m] = ask(all[m], t);
    if (!answers[m].modulus.empty()) maps.push_back(answers[m].modulus);
  }
  const std::vector<std::uint8_t> judged = judged_nodes(maps, t.track.grid, t.phantom);
  for (const auto& [m, answer] : answers) {
    rows[m].seeds.push_back(judge(t, answer, judged));
    if (seed != 1) continue;
    for (const float e : answer.modulus) rows[m].image.push_back(std::round(e));
  }
}

}  // namespace

ModulusFigures measure_modulus(const std::shared_ptr<service::Device>& device, bool quick) {
  Imaging imaging(device);
  const std::vector<Method> all = methods(imaging.queue());
  const std::vector<PhantomCase> of = cases(quick);
  ModulusFigures out{client::Tissue{}.youngs_modulus_pa};
  Phantoms phantoms;
  const std::uint64_t seeds = quick ? kQuickSeeds : kSeeds;
  for (std::size_t c = 0; c < of.size(); ++c) {
    ModulusCase row{of[c].contrast, of[c].diameter_m};
    for (const Method& m : all) row.methods.push_back({m.name, m.ours});
    for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
      measure_seed(imaging.track(phantoms.make(of[c], 1000 + seed)), all, seed, quick, row.methods);
      show_progress(fmt::format("modulus: case {} of {}, seed {} of {}", c + 1, of.size(), seed, seeds));
    }
    out.cases.push_back(std::move(row));
  }
  return out;
}

}  // namespace teletact::bench
