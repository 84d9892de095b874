// The simulated solid patient as a frame source: the probe is pressed at places along z, each the middle of
// an image plane, above the middle of the tissue along x.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "client/acquire/frame_source.h"
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
class SolidSource final : public FrameSource {
 public:
  // Along x under the probe: a third coarser than kSolidSpacing, for 2.4 times less to solve.
  static constexpr double kSpacingM = 0.002;
  // A solve takes half a gigabyte.
  static constexpr unsigned kMostThreads = 4;
  using Progress = std::function<void(std::size_t done, std::size_t total)>;

  // Presses and images every slice, `passes` pairs each with fresh noise, on `threads` threads (0: one per
  // processor), kMostThreads at most; `progress` is called from them, one at a time. Throws TissueError.
  SolidSource(const Tissue& tissue, const SlicePlaces& places, std::size_t passes, unsigned threads,
              const Progress& progress);

  std::size_t window_count() const override { return slices_.size(); }
  double window_width_m() const override { return places_.pitch_m; }
  double compression_m() const override { return compression_m_; }
  std::size_t frames_left(std::size_t slice) const override;
  FramePair take(std::size_t slice) override;

 private:
  struct Slice {
    std::vector<FramePair> passes;
    std::size_t taken = 0;
  };
  SlicePlaces places_;
  double compression_m_;
  std::vector<Slice> slices_;
};

}  // namespace teletact::client
