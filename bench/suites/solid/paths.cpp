// Ways of a finger over simulated solid patients, at the speed of the demo, answered by a session in real
// time as its planner chooses, by the nodes that were given and by nodes half as far apart: whether what is
// stated holds the patient's own force along each way, and what each takes of the processor.
#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>
#include <thread>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/felt/patient_truth.h"
#include "bench/rigid_contact.h"
#include "bench/suites/solid/solid.h"
#include "client/patient/solid_patient.h"
#include "service/device/device.h"
#include "service/scene/scene.h"
#include "service/touch_plane/touch_session.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

using client::SolidPatient;
using service::Vector3;

// As the demo: circles of 8 mm that drift from one end to the other, 20 mm/s, 2 mm deep.
constexpr double kSpeedMS = 0.020, kCircleM = 0.008, kIndentationM = 0.002, kBeginM = 0.025, kEndM = 0.087;
constexpr double kLastsS = 6, kPeriodS = 0.010;
constexpr service::Fingertip kTip;

struct Sample {
  double time_s = 0, true_n = 0, error = 0;  // over the true force
  double stated = 0, stated_linear = 0;      // half of the 95 % interval, over the force that was felt
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Sample, time_s, true_n, error, stated, stated_linear)

// One way of one finger by one kind of model.
struct Way {
  std::uint64_t patient = 0;
  std::string by;
  double ready_s = 0, processor_s = 0;  // of the processor, all threads: until the first answer, on the way
  double held = 0, held_linear = 0;     // share of the way where the interval holds the true force
  double error_p50 = 0, error_max = 0, stated_p50 = 0;  // stated without finite strain
  double closed = 0, failed = 0;                        // shares of the answers: without nodes; no force
  std::vector<Sample> samples{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Way, patient, by, ready_s, processor_s, held, held_linear, error_p50,
                                   error_max, stated_p50, closed, failed, samples)

// Of all ways by one kind of model.
struct Kind {
  std::string by;
  double ready_s = 0, processor_s = 0, min_held = 0, min_held_linear = 0, error_p50 = 0, error_max = 0,
         within_tolerance = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Kind, by, ready_s, processor_s, min_held, min_held_linear, error_p50,
                                   error_max, within_tolerance)

struct Figures {
  double load_average = 0;  // when it began: other programs' if above 0
  std::size_t ways_each = 0;
  std::vector<Kind> kinds{};
  std::vector<Way> ways{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, load_average, ways_each, kinds, ways)

// Which nodes the patient is given on, m apart, and how it is touched.
struct Model {
  const char* name;
  double spacing_m;
  service::SolvePath path;
};
constexpr std::array kModels{Model{"planned", 0.002, service::SolvePath::kAuto},
                             Model{"nodes 2 mm apart", 0.002, service::SolvePath::kGradients},
                             Model{"nodes 1 mm apart", 0.001, service::SolvePath::kGradients}};

// The hand's circles (client/haptic/hand.cpp). Ways begin at other places of them, and every other one goes
// back.
Vector3 place(std::size_t way, double time_s) {
  constexpr double kTurn = 2 * std::numbers::pi;  // of the circles, over the drift
  const double drift_m = std::fmod(0.011 * double(way) + kSpeedMS / kTurn * time_s, kEndM - kBeginM);
  const double angle = kTurn * drift_m / kCircleM + double(way);
  const double along_m = way % 2 == 0 ? kBeginM + drift_m : kEndM - drift_m;
  return {along_m + kCircleM * std::sin(angle), kIndentationM, kCircleM * std::cos(angle)};
}

std::shared_ptr<service::Scene> scene_of(const SolidPatient& patient, double spacing_m) {
  const auto elements = [&](double length_m) { return std::size_t(std::lround(length_m / spacing_m)); };
  service::ExplicitModulus e;
  e.x_m = service::uniform_coordinates(0, SolidPatient::kWidthM, elements(SolidPatient::kWidthM));
  e.y_m = service::uniform_coordinates(0, SolidPatient::kDepthM, 40);
  e.z_m = service::uniform_coordinates(-SolidPatient::kEndM, SolidPatient::kEndM,
                                       elements(2 * SolidPatient::kEndM));
  const auto middle = [](const std::vector<double>& nodes, std::size_t n) {
    return (nodes[n] + nodes[n + 1]) / 2;
  };
  for (std::size_t k = 0; k + 1 < e.z_m.size(); ++k)
    for (std::size_t j = 0; j + 1 < e.y_m.size(); ++j)
      for (std::size_t i = 0; i + 1 < e.x_m.size(); ++i)
        e.youngs_modulus_pa.push_back(
            patient.modulus_pa(middle(e.x_m, i), middle(e.y_m, j), middle(e.z_m, k)));
  service::SceneGeometry geometry;
  geometry.width_m = SolidPatient::kWidthM, geometry.depth_m = SolidPatient::kDepthM;
  geometry.poisson_ratio = SolidPatient::kPoissonRatio;
  return std::make_shared<service::Scene>("patient", geometry, std::move(e),
                                          std::make_shared<service::VersionCounter>(nullptr));
}

struct Answered {
  double time_s;
  Vector3 position_m;
  service::ContactAnswer contact;
};

std::vector<Answered> felt(const std::shared_ptr<service::Device>& device,
                           const std::shared_ptr<service::Scene>& scene, service::SolvePath path,
                           std::size_t way_number, Way& way) {
  std::optional<service::TouchSession> session;
  const auto all_processor_s = [](auto&& work) {
    return processor_seconds_of(work, CLOCK_PROCESS_CPUTIME_ID);
  };
  way.ready_s = all_processor_s([&] {
    session.emplace(scene, service::TouchOptions{.fingertip = kTip, .path = path}, device);
    session->solve(place(way_number, 0));
  });
  std::vector<Answered> out;
  way.processor_s = all_processor_s([&] {
    const auto begin = Clock::now();
    for (double due_s = kPeriodS; due_s < kLastsS;) {
      std::this_thread::sleep_until(begin + std::chrono::duration<double>(due_s));
      const double time_s = seconds_since(begin);
      const Vector3 at = place(way_number, time_s);
      const service::TouchAnswer answer = session->solve(at);
      out.push_back({time_s, at, answer.contact});  // FAILED: no force, and none stated
      way.closed += answer.contact.path == service::SolvePath::kShares;
      way.failed += answer.contact.state != service::ContactState::kContact;
      session->look_ahead();
      due_s =
          kPeriodS * std::max(std::round(due_s / kPeriodS) + 1, std::ceil(seconds_since(begin) / kPeriodS));
    }
  });
  way.closed /= double(out.size()), way.failed /= double(out.size());
  return out;
}

void judge(const std::vector<Answered>& answers, PatientTruth& truth, std::size_t samples, Way& way) {
  std::vector<double> errors, stated;
  for (std::size_t s = 0; s < samples; ++s) {
    const Answered& a = answers[(2 * s + 1) * answers.size() / (2 * samples)];
    const Eigen::Vector3d true_n = truth.at(a.position_m).force_n, felt_n(a.contact.force_n.data());
    Sample sample{a.time_s, true_n.norm(), (felt_n - true_n).norm() / true_n.norm(),
                  a.contact.budget.half_width(), linear_half_width(a.contact.budget)};
    const double off_n = sample.error * sample.true_n;
    way.held += double(off_n <= sample.stated * felt_n.norm()) / double(samples);
    way.held_linear += double(off_n <= sample.stated_linear * felt_n.norm()) / double(samples);
    errors.push_back(sample.error), stated.push_back(sample.stated_linear);
    way.samples.push_back(sample);
  }
  const Quantiles error = quantiles(errors);
  way.error_p50 = error.p50, way.error_max = error.max, way.stated_p50 = median_of(stated);
}

Kind kind_of(const std::vector<Way>& ways, const char* name) {
  Kind kind{.by = name, .min_held = 1, .min_held_linear = 1};
  std::vector<double> errors;
  for (const Way& way : ways) {
    if (way.by != name) continue;
    kind.ready_s += way.ready_s, kind.processor_s += way.processor_s;
    kind.min_held = std::min(kind.min_held, way.held);
    kind.min_held_linear = std::min(kind.min_held_linear, way.held_linear);
    for (const Sample& s : way.samples) {
      errors.push_back(s.error);
      kind.within_tolerance += service::Tolerance{}.of_n(s.true_n) >= s.error * s.true_n;
    }
  }
  kind.within_tolerance /= double(errors.size());
  const Quantiles error = quantiles(errors);
  kind.error_p50 = error.p50, kind.error_max = error.max;
  return kind;
}

void promise(const Figures& f, Promises& promises) {
  const Kind &planned = f.kinds[0], &fine = f.kinds[2];
  promises.push_back({"planned_interval_holds_least_of_a_way", planned.min_held, 0.9, "1", false});
  promises.push_back(
      {"planned_interval_holds_least_without_finite_strain", planned.min_held_linear, 0.9, "1", false});
  promises.push_back({"planned_within_tolerance", planned.within_tolerance, 0.95, "1", false});
  promises.push_back({"planned_over_finest_processor",
                      (planned.ready_s + planned.processor_s) / (fine.ready_s + fine.processor_s), 1.0 / 3,
                      "1"});
}

Figures measure(bool quick, Promises& promises) {
  const auto device = service::Device::open();
  Figures f{.ways_each = std::size_t(quick ? 1 : 10)};
  getloadavg(&f.load_average, 1);
  constexpr std::size_t kOfAPatient = 2;
  const std::size_t samples = quick ? 4 : 20;
  for (std::size_t way = 0; way < f.ways_each; ++way) {
    const std::uint64_t seed = 1 + way / kOfAPatient;
    const SolidPatient patient = client::random_solid_patient(seed);
    PatientTruth truth(device->queue(), true_solid(patient), kTip);
    for (const Model& model : kModels) {
      Way& w = f.ways.emplace_back(Way{.patient = seed, .by = model.name});
      judge(felt(device, scene_of(patient, model.spacing_m), model.path, way, w), truth, samples, w);
      std::printf(
          "paths: patient %zu, way %zu, %-16s: %5.2f s of the processor to be ready, %5.2f s for %.0f s; off "
          "by "
          "%.2f %% (median), %.1f %% (most), stated %.1f %%; inside %3.0f %% of the way (finite strain's "
          "part "
          "included: %3.0f %%); %3.0f %% without nodes\n",
          std::size_t(seed), way, model.name, w.ready_s, w.processor_s, kLastsS, 100 * w.error_p50,
          100 * w.error_max, 100 * w.stated_p50, 100 * w.held_linear, 100 * w.held, 100 * w.closed);
      std::fflush(stdout);
    }
  }
  for (const Model& model : kModels) f.kinds.push_back(kind_of(f.ways, model.name));
  promise(f, promises);
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  Curve error{.title = "off by", .ours = true, .line = false}, stated{.title = "stated", .line = false};
  double before_s = 0;
  for (const Way& way : f.ways) {
    if (way.by != kModels[0].name) continue;
    for (const Sample& s : way.samples)
      error.add(before_s + s.time_s, 100 * s.error), stated.add(before_s + s.time_s, 100 * s.stated_linear);
    before_s += kLastsS;
  }
  plot(
      folder / "solid_paths.png",
      script_of({error, stated}, axes(fmt::format("{} ways over simulated patients, as planned", f.ways_each),
                                      "time (s)", "of the force (%)")));
}

}  // namespace

Part solid_paths() {
  return make_part("paths", measure, draw);
}

}  // namespace teletact::bench
