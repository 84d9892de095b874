#include "bench/suites/plan/cases.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>
#include <utility>

#include "bench/suites/plan/models.h"
#include "bench/suites/plan/scenes.h"
#include "bench/suites/plan/truth.h"
#include "service/base/choices.h"
#include "service/base/planner.h"
#include "service/contact/shares_touch.h"
#include "service/contact/solid_contact.h"
#include "service/touch_plane/touch_session.h"

namespace teletact::bench {
namespace {

using service::Vector3;

// Of a block of 64 x 64 mm the first 48 x 48 mm are given; the finger is in the middle of an element there.
constexpr std::size_t kVoxels = 32, kGiven = 24;
constexpr double kBlockM = kVoxels * kVoxelM, kGivenM = kGiven * kVoxelM, kAtM = (kGivenM + kVoxelM) / 2;
constexpr service::Fingertip kTip;

struct Case {
  const char* name;
  double indentation_m = 0.002, poisson_ratio = 0.49, depth_m = 0.040;
  double x_m = kGivenM / 2;       // of the finger; z in the middle
  std::vector<PlanLump> lumps{};  // x and z from the finger
  double believed = 1;            // the modulus that is given over the true one
  double deviation = 0;           // of ln E, as it is given
  std::size_t iterations = 0;     // not 0: that model answers after so many, not the session
  bool sideways = false;          // the force along x alone
};

// What is given of a modulus that force sensor and contact area put off.
double usual_deviation() {
  return std::hypot(service::choices::kForceDeviation, service::choices::kAreaDeviation);
}

std::vector<Case> cases() {
  const auto ball = [](double x_m, double depth_m, double radius_m, double contrast) {
    return PlanLump{{x_m, depth_m, 0}, radius_m, contrast};
  };
  const std::vector overlapping{ball(0, 0.008, 0.005, 5), ball(0.003, 0.011, 0.006, 5)},
      extreme{ball(-0.003, 0.007, 0.005, 10), ball(0.003, 0.010, 0.006, 10)};
  return {
      {.name = "first touch over a lump", .indentation_m = 4.5e-4, .lumps = {ball(0, 0.006, 0.005, 10)}},
      {.name = "contrast 30 at the surface, 1 mm deep",
       .indentation_m = 0.001,
       .lumps = {ball(0, 0.002, 0.006, 30)}},
      {.name = "contrast 30 at the surface, 3 mm deep",
       .indentation_m = 0.003,
       .lumps = {ball(0, 0.002, 0.006, 30)}},
      {.name = "lump beside what was given, 8 mm away",
       .x_m = kGivenM - 0.008,
       .lumps = {ball(0.014, 0.008, 0.006, 10)}},
      {.name = "nodes that touch change with E: beside contrast 30",
       .indentation_m = 0.003,
       .lumps = {ball(0.008, 0.004, 0.005, 30)}},
      {.name = "soft at the surface", .lumps = {ball(0, 0.003, 0.005, 0.1)}},
      {.name = "nu 0.4999 in 10 mm",
       .poisson_ratio = 0.4999,
       .depth_m = 0.010,
       .lumps = {ball(0, 0.006, 0.003, 5)}},
      {.name = "force sensor 10 % off", .believed = 1.1, .deviation = usual_deviation()},
      {.name = "force sensor 30 % off", .believed = 1.3, .deviation = usual_deviation()},
      {.name = "lateral force near zero", .lumps = {ball(0.002, 0.012, 0.005, 5)}, .sideways = true},
      {.name = "lumps that overlap", .lumps = overlapping},
      {.name = "hard lumps that overlap", .lumps = extreme},
      {.name = "lumps that overlap, two iterations", .lumps = overlapping, .iterations = 2},
  };
}

// Of the block; its own places are from its middle.
PlanScene scene_of(const Case& c, std::vector<PlanLump> lumps) {
  PlanScene scene{.kind = c.name, .depth_m = c.depth_m, .poisson_ratio = c.poisson_ratio};
  scene.nx = scene.nz = kVoxels;
  scene.modulus_pa.assign(kVoxels * kVoxels * std::size_t(std::lround(c.depth_m / kVoxelM)), kPlanModulusPa);
  for (PlanLump& lump : lumps) {
    lump.centre_m[0] += c.x_m - kBlockM / 2, lump.centre_m[2] += kAtM - kBlockM / 2;
    add_lump(scene, lump);
  }
  return scene;
}

PlanPose pose_of(const Case& c) {
  return {c.x_m - kBlockM / 2, kAtM - kBlockM / 2, c.indentation_m};
}
Vector3 in_block(const Case& c) {
  return {c.x_m, c.indentation_m, kAtM};
}

std::shared_ptr<service::Scene> given(const Case& c, const PlanScene& all) {
  service::ExplicitModulus e;
  for (std::size_t n = 0; n <= kGiven; ++n) e.x_m.push_back(double(n) * kVoxelM);
  e.z_m = e.x_m;
  for (std::size_t j = 0; j <= all.layers(); ++j) e.y_m.push_back(double(j) * kVoxelM);
  for (std::size_t k = 0; k < kGiven; ++k)
    for (std::size_t j = 0; j < all.layers(); ++j)
      for (std::size_t i = 0; i < kGiven; ++i)
        e.youngs_modulus_pa.push_back(c.believed * all.modulus_pa[i + kVoxels * (k + kVoxels * j)]);
  if (c.deviation > 0) {
    for (std::size_t k = 0; k < kGiven; ++k) e.slices_m.push_back((double(k) + 0.5) * kVoxelM);
    e.log_deviation.assign(e.youngs_modulus_pa.size(), c.deviation);
  }
  service::SceneGeometry geometry;
  geometry.width_m = kGivenM, geometry.depth_m = c.depth_m, geometry.poisson_ratio = c.poisson_ratio;
  return std::make_shared<service::Scene>("case", geometry, std::move(e),
                                          std::make_shared<service::VersionCounter>(nullptr));
}

// Without the sentence on strain, which all of these touches are told.
std::string said(const service::TouchAnswer& answer) {
  std::string words;
  for (std::size_t begin = 0; begin < answer.warning.size();) {
    const std::size_t end = std::min(answer.warning.find("; ", begin), answer.warning.size());
    const std::string part = answer.warning.substr(begin, end - begin);
    if (!part.starts_with("strain ")) words += (words.empty() ? "" : "; ") + part;
    begin = end + 2;
  }
  switch (answer.status) {
    case service::TouchStatus::kOk:
      return words;
    case service::TouchStatus::kDegraded:
      return "DEGRADED: " + words;
    default:
      return "FAILED: " + words;
  }
}

service::TouchAnswer answered(const std::shared_ptr<service::Device>& device, const Case& c,
                              const std::shared_ptr<service::Scene>& scene, service::SolvePath path) {
  service::TouchSession session(scene, {.fingertip = kTip, .path = path}, device);
  session.solve({c.x_m, -0.001, kAtM});
  return session.solve({c.x_m, c.indentation_m, kAtM});
}

// On nodes 1 mm apart, in double; NaN where they have no contact.
Vector3 converged_n(const service::Queue& queue, const Case& c, const PlanScene& scene) try {
  service::SolidContact<double> fine(queue, scene.tissue(2));
  fine.touch(kTip, in_block(c), {.force_error = 1e-4});
  return fine.felt_answer(kTip, in_block(c)).force_n;
} catch (const std::domain_error&) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  return {kNone, kNone, kNone};
}

// Axial; of the converged contact where a rigid tip's does not settle.
double truth_n(const service::Queue& queue, const Case& c, const PlanScene& scene) try {
  RigidContact coarse(queue, scene.tissue(1)), fine(queue, scene.tissue(2));
  return true_force(coarse, fine, pose_of(c)).force_n();
} catch (const BenchError&) {
  return -converged_n(queue, c, scene)[1];
}

HardCase measured(const std::shared_ptr<service::Device>& device, const Case& c) {
  show_progress(c.name);
  const PlanScene scene = scene_of(c, c.lumps);
  const service::Queue queue = device->queue();
  HardCase out{.name = c.name};
  const double axial_n = truth_n(queue, c, scene);
  out.true_n = c.sideways ? -converged_n(queue, c, scene)[0] : axial_n;
  const auto felt_n = [&](const service::ContactAnswer& a) { return -a.force_n[c.sideways ? 0 : 1]; };
  const auto error = [&](double force_n) { return std::abs(force_n - out.true_n) / axial_n; };
  const auto known = given(c, scene);
  const service::TouchAnswer shares = answered(device, c, known, service::SolvePath::kShares);
  out.shares_error = error(felt_n(shares.contact)),
  out.shares_stated = linear_half_width(shares.contact.budget);
  if (c.iterations > 0) {
    out.by = fmt::format("M3 {}", c.iterations);
    try {
      service::SolidContact<float> nodes(queue, scene.tissue(1));
      nodes.feel();
      nodes.correct(kTip, in_block(c), 0, c.iterations);
      const service::ContactAnswer a = nodes.felt_answer(kTip, in_block(c));
      out.felt_n = felt_n(a), out.stated = linear_half_width(a.budget);
    } catch (const std::domain_error& none) {
      out.said = none.what();
    }
  } else {
    const service::TouchAnswer answer = answered(device, c, known, service::SolvePath::kAuto);
    out.felt_n = felt_n(answer.contact), out.stated = linear_half_width(answer.contact.budget);
    out.by = answer.path == service::SolvePath::kShares ? "M1" : "M3", out.said = said(answer);
  }
  out.error = error(out.felt_n);
  return out;
}

}  // namespace

std::vector<HardCase> hard_cases(const std::shared_ptr<service::Device>& device, bool quick,
                                 const std::function<void(const HardCase&)>& each) {
  std::vector<HardCase> out;
  for (const Case& c : cases()) {
    if (quick && out.size() == 2) break;
    each(out.emplace_back(measured(device, c)));
  }
  return out;
}

std::size_t changes_on_a_border(const std::shared_ptr<service::Device>& device) {
  constexpr double kEachS = 0.05, kTurnsHz = 1, kAsideM = 5e-4;
  constexpr std::chrono::minutes kLasts{10};
  const Case c{.name = "a border", .lumps = {{{0, 0.007, 0}, 0.004, 4}}};
  service::SolidContact<float> contact(device->queue(), scene_of(c, c.lumps).tissue(1));
  std::mutex solving;
  contact.learn_shares(device->queue(), solving);
  const auto shares = contact.shares(kTip);
  const auto over = [&](double aside_m) {
    Vector3 at = in_block(c);
    at[0] += aside_m;
    return shares->over(at, {}, service::FiniteStrain::kLeftOut);
  };
  double over_m = 0, beside_m = kAtM;  // shares are not good enough, they are
  if (!(over(over_m) > 1 && over(beside_m) <= 1)) throw BenchError("shares have no border");
  for (int halvings = 0; halvings < 30; ++halvings) {
    const double middle_m = (over_m + beside_m) / 2;
    (over(middle_m) > 1 ? over_m : beside_m) = middle_m;
  }
  service::Planner planner;
  const service::Planner::Clock::time_point begin{};
  std::size_t changes = 0;
  bool by_shares = planner.takes_shares(over(0), begin);  // over the lump: by the nodes
  const auto steps = static_cast<int>(std::chrono::duration<double>(kLasts).count() / kEachS);
  for (int step = 1; step < steps; ++step) {
    const double time_s = kEachS * step;
    const double aside_m = beside_m + kAsideM * std::sin(2 * std::numbers::pi * kTurnsHz * time_s);
    const auto now = begin + std::chrono::duration_cast<service::Planner::Clock::duration>(
                                 std::chrono::duration<double>(time_s));
    const bool before = std::exchange(by_shares, planner.takes_shares(over(aside_m), now));
    changes += before != by_shares;
  }
  return changes;
}

}  // namespace teletact::bench
