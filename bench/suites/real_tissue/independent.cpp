// Rows whose tissue and RF are made by nothing that the project's own patient has.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <random>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/independent/plane_waves.h"
#include "bench/independent/pressed_block.h"
#include "bench/suites/real_tissue/rows.h"

namespace teletact::bench {
namespace {

constexpr double kPadKnown = .05, kFaceKnown = .03;  // standard deviations

// Of each block that was asked for.
using Solved = std::vector<std::pair<Block, std::shared_ptr<const PressedBlock>>>;

std::shared_ptr<const PressedBlock> pressed(const Block& block, Solved& solved) {
  const auto known = std::ranges::find(solved, block, &Solved::value_type::first);
  if (known != solved.end()) return known->second;
  return solved.emplace_back(block, std::make_shared<const PressedBlock>(block)).second;
}

// What is stated, over the truth.
struct Stated {
  double elevation = 1, depth = 1;
  bool bare = false;  // whatever the topmost layer is
};

// What a user knows is stated: the face, the depth, and the speed of sound that the scanner takes.
Window window_of(const Block& block, const PlaneWaves& waves, const Stated& stated, Solved& solved,
                 std::uint64_t seed) {
  Window w;
  std::shared_ptr<const PressedBlock> of;
  w.truth_s = seconds_of([&] { of = pressed(block, solved); });
  const PlaneWavePair rf = plane_wave_pair(
      waves, [&](double x, double y) { return of->at(x, y); }, seed);
  const auto frame = [&](const std::vector<std::int16_t>& samples) {
    return service::RfFrame{waves.samples, waves.elements, {samples.begin(), samples.end()}};
  };
  w.geometry = {waves.center_frequency_hz, waves.sampling_frequency_hz, waves.stated_speed_m_s,
                waves.pitch_m};
  w.pre = frame(rf.pre), w.post = frame(rf.post);
  w.force = {of->force_n(), block.face_width_m * block.face_across_m};
  const double width_m = waves.pitch_m * static_cast<double>(waves.elements), middle_m = width_m / 2;
  w.extent = {width_m,
              stated.depth * block.depth_m,
              0,
              block.poisson_ratio,
              service::Plane::kSolid,
              stated.elevation * block.face_across_m};
  if (stated.bare)
    w.extent.surface.kind = service::Surface::Kind::kBare;
  else if (block.pad_m > 0) {  // in the force's place
    std::mt19937_64 random(seed);
    const double pad_pa = block.pad_contrast * block.modulus_pa,
                 known_pa = pad_pa * (1 + kPadKnown * std::normal_distribution<double>()(random));
    w.extent.pad = {block.pad_m, known_pa, kPadKnown * block.pad_m, kPadKnown * pad_pa};
    w.extent.probe_elevation_std_m = kFaceKnown * block.face_across_m;
  }
  const double deeper = waves.speed_m_s / waves.stated_speed_m_s;  // than it looks
  if (block.contrast != 1)
    w.lumps = {{middle_m, block.sphere_depth_m / deeper, block.sphere_m, block.contrast, true}};
  w.modulus_pa = [=](double x, double y) { return block.true_modulus(x - middle_m, y * deeper); };
  w.axial_m = [=](double x, double y) { return of->at(x - middle_m, y * deeper).y() / deeper; };
  return w;
}

}  // namespace

std::vector<RealRow> independent_rows() {
  constexpr double kTilt = .1;  // of the push, at the face's ends
  const auto solved = std::make_shared<Solved>();
  std::vector<RealRow> rows;
  const auto add = [&](const std::string& name, double contrast, bool quick, Block block,
                       const PlaneWaves& waves = {}, const Stated& stated = {}) {
    block.contrast = contrast;
    const bool wrong = stated.elevation != 1 || stated.depth != 1;
    rows.push_back(
        {std::string(kIndependent) + name, contrast, quick,
         [=](std::uint64_t seed, double) { return window_of(block, waves, stated, *solved, seed); },
         wrong                             ? Truth::kStatedWrongly
         : block.pad_m > 0 && !stated.bare ? Truth::kUnderPad
         : block.width_m < Block().width_m ? Truth::kIndependentBeside
                                           : Truth::kIndependent});
  };
  Block wide, near, nearer, sliding, near_sliding, tilted;
  near.width_m = .080, near.across_m = .060;
  nearer.width_m = nearer.across_m = .060;
  near_sliding = near, near_sliding.bonded_face = sliding.bonded_face = false;
  tilted.tilt = kTilt * tilted.push_m / (tilted.face_width_m / 2);
  PlaneWaves attenuated, aberrated, faster, dense, all;
  attenuated.attenuation_db_cm_mhz = all.attenuation_db_cm_mhz = .5;
  aberrated.aberration_s = all.aberration_s = 10e-9;
  faster.speed_m_s = all.speed_m_s = 1.02 * faster.stated_speed_m_s;
  dense.scatterers_per_cell = all.scatterers_per_cell = 8;
  add("wide", 1, false, wide);
  add("wide", 3, false, wide);
  add("ends 21 mm beside the face", 1, false, near);
  add("ends 21 mm beside the face", 3, true, near);
  add("ends 11 mm beside the face", 1, false, nearer);
  add("ends 11 mm beside the face", 3, false, nearer);
  for (const double contrast : {.5, 2.}) {
    Block padded = sliding;
    padded.pad_m = .008, padded.pad_contrast = contrast;
    add(fmt::format("no force, pad of {:.0f} kPa", 1e-3 * contrast * padded.modulus_pa), 1, false, padded);
  }
  add("wide, face stated 75 % too long", 3, false, wide, {}, {1.75, 1});
  add("wide, depth stated a half too large", 3, false, wide, {}, {1, 1.5});
  add("wide, depth stated a third too small", 3, false, wide, {}, {1, 0.67});
  add("wide, bare and so stated", 1, false, wide, {}, {1, 1, true});
  Block capsule = wide;
  capsule.pad_m = .001, capsule.pad_contrast = 3;
  add("wide, capsule of 1 mm and 3 times, stated as bare", 1, false, capsule, {}, {1, 1, true});
  add("wide, sliding face", 3, false, sliding);
  add("ends 21 mm beside the face, which slides", 1, false, near_sliding);
  add("wide, 0.5 dB/cm/MHz", 3, false, wide, attenuated);
  add("wide, aberration of 10 ns", 3, false, wide, aberrated);
  add("wide, sound 2 % faster", 3, false, wide, faster);
  add("wide, tilted by 10 %", 3, false, tilted);
  add("wide, 8 scatterers a cell", 3, false, wide, dense);
  add("wide, all of these", 3, true, tilted, all);
  return rows;
}

}  // namespace teletact::bench
