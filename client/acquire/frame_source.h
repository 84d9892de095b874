// Where RF pairs come from: the simulated patient now, a scanner behind the same interface later.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "teletact/v1/elastography.pb.h"

namespace teletact::client {

// One window before and after compression, as it goes over the wire.
struct FramePair {
  teletact::v1::Acquisition acquisition;  // all but `publish`
  std::string pre, post;                  // line after line, axial fastest, of acquisition.dtype()
  std::string made =
      {};  // how they were made of recorded data that are no RF, for people; empty: they are RF
  std::vector<std::string> doubts = {};  // about recorded data, a line each
};

template <class T>
std::string bytes_of(const std::vector<T>& samples) {
  return {reinterpret_cast<const char*>(samples.data()), samples.size() * sizeof(T)};
}

// Windows of the probe's width lie side by side: window k covers [k w, (k + 1) w) of the scene.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual std::size_t window_count() const = 0;
  virtual double window_width_m() const = 0;
  virtual double compression_m() const = 0;  // > 0, what the arm presses between pre and post
  virtual std::size_t frames_left(std::size_t window) const = 0;
  // The next pair of that window; each comes once. Throws std::out_of_range when none is left.
  virtual FramePair take(std::size_t window) = 0;
};

}  // namespace teletact::client
