// VkFFT on OpenCL, where it was found at configure time: real two-dimensional transforms of planes in float,
// in place.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace teletact::bench {

struct TransformFigures {
  double s = 0;    // there and back, median
  double off = 0;  // of what comes back, at most; numbers of size 1
};

// On the OpenCL device of this name. Empty, and why, where it takes no part.
std::optional<TransformFigures> measure_vkfft(const std::string& device, std::size_t nx, std::size_t nz,
                                              std::size_t planes, std::string& absent);

}  // namespace teletact::bench
