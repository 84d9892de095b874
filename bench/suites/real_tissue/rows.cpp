#include "bench/suites/real_tissue/rows.h"

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <random>

#include "bench/basics/clock.h"
#include "client/patient/rf.h"
#include "client/patient/solid_press.h"
#include "client/patient/true_modulus.h"

namespace teletact::bench {
namespace {

using client::Support;
using client::Tissue;

constexpr double kLumpM = 0.010, kHighestM = 0.012, kLowestM = 0.018, kAsideM = 0.015;
constexpr double kHeld = std::numeric_limits<double>::infinity();
constexpr double kMaxGain = 0.03;
constexpr double kPushM = 0.0008;             // 3 % of strain below the face, 1 % at 20 mm
constexpr double kStatedPoissonRatio = 0.49;  // whatever is true

using Draw = std::function<double()>;  // between 0 and 1, of a seed
using Set = std::function<void(Tissue&, const Draw&)>;

Set solid(const std::function<void(client::Solid&)>& set) {
  return [set](Tissue& t, const Draw&) { set(*t.solid); };
}

// Two of a standard deviation are drawn by less than 1 in 20.
double gaussian(const Draw& draw) {
  const double radius = std::sqrt(-2 * std::log(1 - draw()));
  return radius * std::cos(2 * std::numbers::pi * draw());
}

void cylinder(Tissue& t, const Draw&) {
  for (client::Inclusion& i : t.inclusions) i.sphere = false;
}

void as_wide_as_the_probe(Tissue& t, const Draw&) {
  const double left_m = (t.width_m - t.probe.width_m) / 2;
  t.width_m = t.probe.width_m;
  t.solid->elevational_width_m = t.probe.elevation_m;
  for (client::Inclusion& i : t.inclusions) i.x_m -= left_m;
}

void sensor(Tissue& t, const Draw& draw) {
  t.probe.force_gain_error = kMaxGain * gaussian(draw);
  t.probe.force_zero_n = .003 * gaussian(draw);
}

void beam(Tissue& t, double elevation_m) {
  t.ultrasound.elevation_beam_m = elevation_m;
}

// On top of the plain tissue with its lump.
Tissue tissue_of(const Set& set, double contrast, std::uint64_t seed) {
  if (!set) return client::unlike_model(seed, contrast);
  const auto random = std::make_shared<std::mt19937_64>(seed * 0x9E3779B97F4A7C15u + 77);
  const Draw draw = [random] { return static_cast<double>((*random)() >> 11) * 0x1p-53; };
  Tissue t;
  t.width_m = .120, t.depth_m = .040, t.seed = seed, t.probe.compression_m = kPushM;
  t.solid.emplace();
  const double aside = 2 * draw() - 1, deep = draw();
  if (contrast != 1)
    t.inclusions = {
        {t.width_m / 2 + kAsideM * aside, kHighestM + (kLowestM - kHighestM) * deep, kLumpM, contrast, true}};
  set(t, draw);
  return t;
}

// The depth is stated where its bottom is imaged; the face is fitted.
Window window_of(const client::Tissue& t, std::uint64_t seed, double spacing_m) {
  Window w;
  client::ProbeState state;
  w.truth_s = seconds_of([&] {
    state = client::press_solid(t, (t.width_m - t.probe.width_m) / 2, t.probe.compression_m, spacing_m);
  });
  const client::RfPair rf =
      client::with_noise(client::simulate_rf(t, state, client::RfFrame::kProbe, seed), seed + 1);
  const auto frame = [&](const std::vector<std::int16_t>& samples) {
    return service::RfFrame{
        rf.geometry.sample_count, rf.geometry.line_count, {samples.begin(), samples.end()}};
  };
  w.geometry = {t.ultrasound.center_frequency_hz, t.ultrasound.sampling_frequency_hz,
                t.ultrasound.sound_speed_m_s, rf.geometry.line_pitch_m};
  w.pre = frame(rf.pre), w.post = frame(rf.post);
  w.force = {client::sensed_force(t.probe, state.force_n, seed + 2), state.contact_area_m2};
  w.extent = {t.width_m, t.imaged_depth_m(), state.window_x_m, kStatedPoissonRatio, service::Plane::kSolid};
  w.extent.depth_stated = t.imaged_depth_m() == t.depth_m;
  w.lumps = t.inclusions;
  const auto tissue = std::make_shared<const client::Tissue>(t);
  w.modulus_pa = [tissue, truth = client::TrueModulus(*tissue)](double x, double y) { return truth(x, y); };
  w.axial_m = [state](double x, double y) { return state.field->at(x, y).y - state.motion(x, y).y; };
  return w;
}

}  // namespace

std::vector<RealRow> patient_rows() {
  std::vector<RealRow> rows;
  const auto add = [&](const std::string& name, double contrast, bool quick, const Set& set) {
    rows.push_back({name, contrast, quick, [=](std::uint64_t seed, double spacing_m) {
                      return window_of(tissue_of(set, contrast, seed), seed, spacing_m);
                    }});
  };
  // A quick run has each once, 3 and 5 in turn.
  auto row = [&, quick_contrast = 5.](const std::string& name, const Set& set) mutable {
    quick_contrast = 8 - quick_contrast;
    for (const double contrast : {3., 5.}) add(name, contrast, contrast == quick_contrast, set);
  };
  const Set nothing = [](Tissue&, const Draw&) {};
  add("no lump", 1, true, nothing);
  add("no lump, capsule 2 mm", 1, true, solid([](auto& s) { s.capsule_m = .002, s.capsule_contrast = 3; }));
  row("sphere", nothing);
  row("cylinder", cylinder);
  row("friction 0.3", solid([](auto& s) { s.friction = .3; }));
  row("held by the probe", solid([](auto& s) { s.friction = kHeld; }));
  row("as wide as the probe", as_wide_as_the_probe);
  row("as wide as the probe and held", [](Tissue& t, const Draw& d) {
    as_wide_as_the_probe(t, d);
    t.solid->friction = kHeld;
  });
  row("60 mm across", solid([](auto& s) { s.elevational_width_m = .060; }));
  row("sliding bottom", solid([](auto& s) { s.support = Support::kSliding; }));
  row("bed of 10 mm, 2 kPa", solid([](auto& s) { s.support = Support::kBed; }));
  row("60 mm deep, 40 mm imaged", [](Tissue& t, const Draw&) {
    t.ultrasound.depth_m = t.depth_m;
    t.depth_m = .060;
  });
  row("uneven by 10 %", solid([](auto& s) { s.uneven = .1; }));
  row("contact in part, lean 2.5 mm", solid([](auto& s) { s.lean_m = .0025; }));
  row("capsule 1 mm of 3", solid([](auto& s) { s.capsule_m = .001, s.capsule_contrast = 3; }));
  row("capsule 2 mm of 3", solid([](auto& s) { s.capsule_m = .002, s.capsule_contrast = 3; }));
  row("modulus falls by 1.6 from top to bottom", solid([](auto& s) { s.bottom_contrast = 1 / 1.6; }));
  row("texture 5 %", solid([](auto& s) { s.texture = .05; }));
  row("texture 20 %", solid([](auto& s) { s.texture = .20; }));
  row("beam 1 mm across", [](Tissue& t, const Draw&) { beam(t, .001); });
  row("beam 3 mm across, wider with depth, 0.5 dB/cm/MHz", [](Tissue& t, const Draw&) {
    beam(t, .003);
    t.ultrasound.beam_growth = 1;
    t.ultrasound.attenuation_db_cm_mhz = .5;
  });
  row("sensor: gain 3 %, zero 3 mN", sensor);
  row("nu 0.495", [](Tissue& t, const Draw&) { t.poisson_ratio = .495; });
  row("all together", {});
  return rows;
}

}  // namespace teletact::bench
