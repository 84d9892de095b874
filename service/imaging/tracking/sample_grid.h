// Nodes on the samples of a frame, frames padded with zeros as the kernels of this folder want them, and the
// ranges that those kernels are launched over.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

inline constexpr std::size_t kGroup = 32;  // WORK_GROUP of the kernels of imaging

// One work-item a node.
inline Range over(auto nodes) {
  return {{static_cast<std::size_t>(nodes), 1, 1}, {kGroup, 1, 1}};
}

// An array of `host`, on its way.
template <class T>
Array<T> sent(const Queue& queue, std::vector<T> host) {
  auto array = queue.array<T>(host.size());
  queue.send(array, std::move(host));
  return array;
}

// Node (i, j) lies at A-line first_line + i line_step, sample first_sample + j sample_step; index i + nx j.
// An argument of kernels: Nodes of kernels/frames.clh.
struct SampleGrid {
  int nx = 1, ny = 1;
  int first_line = 0, line_step = 1;
  int first_sample = 0, sample_step = 1;
  int nodes() const { return nx * ny; }
};
static_assert(sizeof(SampleGrid) == 6 * sizeof(int));

inline constexpr int kMinStep = 8;  // samples between nodes, which warp needs
// A length in steps of a grid, and half of a window's: at least one.
int whole_steps(double length_m, double step_m);
int half_width(double window_m, double step_m);

// The grid of these steps, centred on the frame; steps are cut to the frame's size.
SampleGrid centred_grid(const RfFrame&, int line_step, int sample_step);

// In metres; x from the first A-line's left border (half a pitch before its centre).
ImageGrid image_grid(const SampleGrid&, const AcquisitionGeometry&);

// Sample k of A-line l lies at origin + l * stride + k. An argument of kernels: Layout of kernels/frames.clh.
struct ImageLayout {
  int origin = 0, stride = 0;
};
static_assert(sizeof(ImageLayout) == 2 * sizeof(int));
// `samples` zeros on both sides of a line and `lines` lines of zeros on both sides of the frame.
struct Padding {
  ImageLayout layout;
  std::size_t total = 0;
};
Padding padding(const RfFrame&, int samples, int lines);

// Samples of an A-line, from the first to before the end. An argument of kernels: int2.
struct EchoSpan {
  int first = 0, end = 0;
  bool operator==(const EchoSpan&) const = default;
};

// Writes the frame into an image whose padding is there, without what a converter added to the echoes: it
// moves with no tissue. Zeros outside of the spans, one for each line.
void write_into(std::vector<float>& image, const RfFrame&, const Padding&, const std::vector<EchoSpan>&);
// The whole frame with its padding.
std::vector<float> padded(const RfFrame&, const Padding&);

// Throws std::invalid_argument naming the field and the remedy: sizes, NaN or infinite samples, frames of
// unequal size, frequencies, sound speed, pitch, depth.
void validate(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&);

}  // namespace teletact::service
