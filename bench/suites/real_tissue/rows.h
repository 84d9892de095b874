// The rows of `real-tissue`: solids unlike what an estimator assumes, one level at a time, and all together.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "client/patient/tissue.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {

// A solid pressed between two frames: what an estimator gets, and the truth, at scene coordinates.
struct Window {
  service::AcquisitionGeometry geometry;
  service::RfFrame pre, post;
  service::ProbeForce force;
  service::TissueExtent extent;  // as it is stated of a solid
  std::vector<client::Inclusion> lumps;
  std::function<double(double x_m, double y_m)> modulus_pa,
      axial_m;         // axial displacement, seen from the probe
  double truth_s = 0;  // until the solid was solved
};

// By whom a row's RF and truth are made, and whether its tissue reaches far enough beyond the face for its
// modulus to be told from a grading; or whether its modulus is told by a pad, or what is stated is wrong.
enum class Truth { kPatient, kIndependent, kIndependentBeside, kUnderPad, kStatedWrongly };

struct RealRow {
  std::string name;     // with its level
  double contrast = 1;  // of the lump of 10 mm, centre 12 to 18 mm deep; 1: no lump
  bool quick = false;   // one of those that a quick run has
  // `spacing_m`: of the patient's truth, as of press_solid(). All else by the seed.
  std::function<Window(std::uint64_t seed, double spacing_m)> window;
  Truth truth = Truth::kPatient;
};

// 120 x 40 mm of 10 kPa, 100 mm across, bonded, frictionless, a probe of 60 x 10 mm on its middle; a sphere
// where the row has contrast. Each row changes one thing.
std::vector<RealRow> patient_rows();

// 10 kPa, 40 mm deep, bonded, under a bonded face of 38 x 8 mm, by finite elements and RF that share nothing
// with the patient's; a sphere 15 mm deep where the row has contrast. Rows of the same tissue share its
// solution. Their names begin so.
inline constexpr std::string_view kIndependent = "independent: ";
std::vector<RealRow> independent_rows();

}  // namespace teletact::bench
