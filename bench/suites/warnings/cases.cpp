#include "bench/suites/warnings/cases.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "client/patient/rf.h"
#include "client/patient/solid_press.h"
#include "client/patient/true_modulus.h"

namespace teletact::bench {
namespace {

using client::Support;
using client::Tissue;
using service::ModulusFlag;
using service::ModulusKind;

constexpr double kPushM = 0.8e-3, kSpacingM = 0.002, kWidthM = 0.060, kElevationM = 0.010, kDepthM = 0.040;

// Solid tissue that an estimate is made for: 3 % friction and all, but nothing that it does not have.
Tissue plain(std::uint64_t seed) {
  std::mt19937_64 random(seed * 7919 + 3);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Tissue t;
  t.width_m = 0.120, t.depth_m = kDepthM, t.seed = seed;
  t.probe.width_m = kWidthM, t.probe.elevation_m = kElevationM, t.probe.compression_m = kPushM;
  client::Solid solid;
  solid.friction = between(0, 0.3), solid.uneven = between(-0.1, 0.1), solid.texture = between(0, 0.1);
  client::Inclusion lump;
  lump.x_m = t.width_m / 2 + between(-0.015, 0.015), lump.y_m = between(0.010, 0.020);
  lump.diameter_m = between(0.006, 0.012), lump.contrast = between(2, 6), lump.sphere = between(0, 1) < 0.5;
  t.inclusions = {lump};
  t.probe.force_gain_error = between(-0.03, 0.03);
  t.solid = solid;
  return t;
}

WarnedWindow pressed(const Tissue& t) {
  const double left_m = (t.width_m - t.probe.width_m) / 2;
  const client::ProbeState probe = client::press_solid(t, left_m, kPushM, kSpacingM);
  std::mt19937_64 random(t.seed * 104729 + 5);
  WarnedWindow w;
  for (std::size_t n = 0; n < kGivenImage.size(); ++n) {
    const double x = left_m + kGivenImage.x_m(n), y = kGivenImage.y_m(n);
    const auto u = probe.field->at(x, y), moved = probe.motion(x, y);
    w.displacement.axial_m.push_back(u.y - moved.y), w.displacement.lateral_m.push_back(u.x - moved.x);
  }
  w.displacement.noise_m = std::uniform_real_distribution<double>(0.3e-6, 1e-6)(random);
  w.tissue = {t.width_m, t.imaged_depth_m(), left_m, 0.49, service::Plane::kSolid};
  w.tissue.probe_elevation_m = kElevationM;
  // A user states the probe's face, whether all of it touches or not.
  w.force = service::ProbeForce{client::sensed_force(t.probe, probe.force_n, t.seed), kWidthM * kElevationM};
  return w;
}

// `share` of the axial strain more to the sides.
void spread(WarnedWindow& w, double share) {
  const std::vector<double>& u = w.displacement.axial_m;
  const std::size_t nx = kGivenImage.nx;
  for (std::size_t j = 0; j < kGivenImage.ny; ++j) {
    const std::size_t row = nx * std::min(j, kGivenImage.ny - 2);
    double moved = 0;
    for (std::size_t i = 0; i < nx; ++i) {
      moved -= share * (u[row + nx + i] - u[row + i]) / kGivenImage.dy_m * kGivenImage.dx_m;
      w.displacement.lateral_m[i + nx * j] += moved;
    }
  }
}

// Nothing is trusted in this part of the columns.
void lose(WarnedWindow& w, double part) {
  w.displacement.trusted.assign(kGivenImage.size(), 1);
  for (std::size_t n = 0; n < kGivenImage.size(); ++n)
    if (static_cast<double>(n % kGivenImage.nx) < part * static_cast<double>(kGivenImage.nx))
      w.displacement.trusted[n] = 0;
}

// A frame of the patient's own tissue, 20 mm wide, as `spoiled`.
WarnedWindow framed(std::uint64_t seed, const std::function<void(service::RfFrame&)>& spoiled) {
  Tissue t;
  t.width_m = t.probe.width_m = 0.020, t.probe.lines = 85, t.depth_m = 0.020;
  std::mt19937_64 random(seed);
  t.ultrasound.snr_db = std::uniform_real_distribution<double>(5, 30)(random);
  const client::ProbeState probe = client::Patient(t, 0.002).press(0, 0.1e-3);
  const client::RfPair pair =
      client::with_noise(client::simulate_rf(t, probe, client::RfFrame::kProbe, seed), seed);
  WarnedWindow w;
  w.frame = {pair.geometry.sample_count, pair.geometry.line_count, {pair.pre.begin(), pair.pre.end()}};
  spoiled(*w.frame);
  return w;
}

// Rectified, and the mean over about a period.
void detect(service::RfFrame& frame) {
  constexpr std::size_t kPeriod = 6;
  const std::vector<float> rf = frame.samples;
  for (std::size_t n = kPeriod; n < rf.size(); ++n) {
    frame.samples[n] = 0;
    for (std::size_t k = 0; k < kPeriod; ++k) frame.samples[n] += std::abs(rf[n - k]);
  }
}

void turn(service::RfFrame& frame) {
  const std::vector<float> rf = frame.samples;
  for (std::size_t n = 0; n < rf.size(); ++n)
    frame.samples[n / frame.sample_count + frame.line_count * (n % frame.sample_count)] = rf[n];
  std::swap(frame.sample_count, frame.line_count);
}

service::KnownModulus told(const Tissue& t, double times) {
  struct Truth {  // which refers to its tissue
    explicit Truth(const Tissue& of) : tissue(of), modulus(tissue) {}
    Tissue tissue;
    client::TrueModulus modulus;
  };
  const auto truth = std::make_shared<const Truth>(t);
  return {[truth, times](double x, double y) { return times * truth->modulus(x, y); },
          [](double, double) { return 0.1; }};
}

WarnedWindow of_plane(const DrawnCase& drawn, std::uint64_t seed, ModulusKind kind,
                      const service::Queue& queue) {
  WarnedWindow w;
  const auto window = std::make_shared<DrawnWindow>(drawn, seed, queue);
  w.plane = window;
  w.tissue = window->input().tissue, w.force = window->input().force, w.kind = kind;
  return w;
}

}  // namespace

std::vector<WarningRow> warning_rows(const service::Queue& queue) {
  // Each tissue is pressed once for all rows that need it.
  const auto kept = std::make_shared<std::map<std::uint64_t, WarnedWindow>>();
  const auto usual = [kept](std::uint64_t seed) {
    if (const auto found = kept->find(seed); found != kept->end()) return found->second;
    return kept->emplace(seed, pressed(plain(seed))).first->second;
  };
  std::vector<WarningRow> rows;
  const auto row = [&](const std::string& name, std::vector<Claim> claims, auto window) {
    rows.push_back({name, std::move(claims), window});
  };
  const auto changed = [usual](auto change) {
    return [usual, change](std::uint64_t seed) {
      WarnedWindow w = usual(seed);
      change(w);
      return w;
    };
  };
  const auto other = [](auto change) {
    return [change](std::uint64_t seed) {
      Tissue t = plain(seed);
      change(t);
      return pressed(t);
    };
  };
  // Of tissue that goes on with a lump of 6 to 12 mm, contrast 2 to 6, in whole contact.
  row("as assumed: friction to 0.3, uneven and texture to 10 %",
      {{ModulusFlag::kNoise, false},
       {ModulusFlag::kMisfit, false},
       {ModulusFlag::kUntracked, false},
       {ModulusFlag::kRamp, false},
       {ModulusFlag::kOutOfPlane, false},
       {ModulusFlag::kExtent, false},
       {ModulusFlag::kDeadline, false},
       {ModulusFlag::kCut, false},
       {ModulusFlag::kModels, false},
       {ModulusFlag::kUnstated, false}},
      usual);
  row("noise of the displacement 8 um",
      {{ModulusFlag::kNoise, true}, {ModulusFlag::kMisfit, false}, {ModulusFlag::kRamp, false}},
      changed([](WarnedWindow& w) { w.displacement.noise_m = 8e-6; }));
  row("bottom slides", {{ModulusFlag::kMisfit, false}},
      other([](Tissue& t) { t.solid->support = Support::kSliding; }));
  row("bed of 10 mm, 2 kPa", {{ModulusFlag::kMisfit, false}},
      other([](Tissue& t) { t.solid->support = Support::kBed; }));
  row("face touches in part, lean 2.5 mm",
      {{ModulusFlag::kMisfit, true}, {ModulusFlag::kNoise, false}, {ModulusFlag::kModels, false}},
      other([](Tissue& t) { t.solid->lean_m = 0.0025; }));
  row("20 % of the image lost", {{ModulusFlag::kUntracked, true}},
      changed([](WarnedWindow& w) { lose(w, 0.2); }));
  row("5 % of the image lost", {{ModulusFlag::kUntracked, false}},
      changed([](WarnedWindow& w) { lose(w, 0.05); }));
  constexpr double kRamp = 2;
  row(fmt::format("modulus falls by {} from top to bottom", kRamp),
      {{ModulusFlag::kRamp, true}, {ModulusFlag::kExtent, false}, {ModulusFlag::kNoise, false}},
      other([](Tissue& t) { t.solid->bottom_contrast = 1 / kRamp; }));
  row("spreads sideways by 0.4 of the strain more", {{ModulusFlag::kOutOfPlane, true}},
      changed([](WarnedWindow& w) { spread(w, 0.4); }));
  row("lump of 30 mm, contrast 3", {{ModulusFlag::kExtent, true}}, other([](Tissue& t) {
        t.inclusions.front().x_m = t.width_m / 2, t.inclusions.front().y_m = 0.018;
        t.inclusions.front().diameter_m = 0.030, t.inclusions.front().contrast = 3;
      }));
  const auto beside = [usual](double times) {
    return [usual, times](std::uint64_t seed) {
      WarnedWindow w = usual(seed);
      w.known = told(plain(seed), times);
      return w;
    };
  };
  row("force twice what neighbours say", {{ModulusFlag::kScale, true}}, beside(0.5));
  row("gain within 3 % beside neighbours", {{ModulusFlag::kScale, false}}, beside(1));
  row("no time", {{ModulusFlag::kCut, true}, {ModulusFlag::kDeadline, false}},
      changed([](WarnedWindow& w) { w.budget.solves = 0; }));
  row("neither face nor depth stated, no time to fit them",
      {{ModulusFlag::kUnstated, true}, {ModulusFlag::kNoise, false}, {ModulusFlag::kModels, false}},
      changed([](WarnedWindow& w) {
        w.tissue.probe_elevation_m = 0, w.tissue.depth_stated = false, w.force.reset();
        w.budget.solves = 0, w.background_pa = 1;
      }));
  const auto of_frames = [&](const char* name, const std::string& provoked, auto spoil) {
    std::vector<Claim> claims;
    for (const char* warning : {"image", "axis"}) claims.push_back({warning, warning == provoked});
    row(name, claims, [spoil](std::uint64_t seed) { return framed(seed, spoil); });
  };
  of_frames("RF, 5 to 30 dB", "", [](service::RfFrame&) {});
  of_frames("envelope for RF", "image", detect);
  of_frames("lines for samples", "axis", turn);
  const DrawnCase deep{}, shallow{.contrast = 3,
                                  .diameter_m = 0.003,
                                  .strain = 0.01,
                                  .noise_m = 0.1e-6,
                                  .texture = true,
                                  .depth_m = 0.010};
  for (const auto& [drawn, provoked] : {std::pair(shallow, true), std::pair(deep, false)})
    row(fmt::format("plane strain, {:.0f} mm deep, nu 0.4999", 1e3 * drawn.depth_m),
        {{ModulusFlag::kPressure, provoked}}, [queue, drawn](std::uint64_t seed) {
          WarnedWindow w = of_plane(drawn, seed, ModulusKind::kIterative, queue);
          w.tissue.poisson_ratio = 0.4999;
          return w;
        });
  row("direct, plane strain, strain 0.3 %, noise 6 um", {{ModulusFlag::kStreaks, true}},
      [queue](std::uint64_t seed) {
        DrawnCase drawn;
        drawn.strain = 0.003, drawn.noise_m = 6e-6;
        return of_plane(drawn, seed, ModulusKind::kDirect, queue);
      });
  row("direct, plane strain, strain 1 %, noise 0.5 um", {{ModulusFlag::kStreaks, false}},
      [queue](std::uint64_t seed) { return of_plane({}, seed, ModulusKind::kDirect, queue); });
  return rows;
}

}  // namespace teletact::bench
