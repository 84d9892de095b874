// The simulated solid patient as a frame source: the probe is pressed at places along z, each the middle of
// an image plane, above the middle of the tissue along x.
#pragma once

#include <string>

#include "client/acquire/prepared_source.h"
#include "client/patient/patient.h"

namespace teletact::client {

// Image planes z_m(0), z_m(1), ... across the probe.
struct SlicePlaces {
  std::size_t count = 1;
  double first_z_m = 0, pitch_m = 0.005;
  double z_m(std::size_t slice) const { return first_z_m + pitch_m * static_cast<double>(slice); }
};

// Why the probe cannot be pressed there, naming the field; empty: it can. `tissue` is valid.
std::string slice_problem(const Tissue& tissue, const SlicePlaces& places);

// Where the image's left border is pressed: the middle of the tissue.
double slice_window_x_m(const Tissue& tissue);

// Window k is slice k, as wide as the slices are apart.
class SolidSource final : public PreparedSource {
 public:
  // Along x under the probe: a third coarser than kSolidSpacing, for 2.4 times less to solve.
  static constexpr double kSpacingM = 0.002;
  // A solve takes half a gigabyte.
  static constexpr unsigned kMaxThreads = 4;

  // Presses and images every slice, `passes` pairs each with fresh noise, on a thread per processor,
  // kMaxThreads at most. Throws TissueError.
  SolidSource(const Tissue& tissue, const SlicePlaces& places, std::size_t passes, const Progress& progress);

  double window_width_m() const override { return places_.pitch_m; }
  double compression_m() const override { return compression_m_; }

 private:
  SlicePlaces places_;
  double compression_m_;
};

}  // namespace teletact::client
