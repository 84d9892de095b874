// Tactile images at a terminal.
#pragma once

#include <string>

#include "client/link/tactile_image.h"

namespace teletact::client {

// Lines of text, x to the right and z downwards, two columns a taxel: the pressure in blocks from light to
// full, full being its largest; beside it what is beyond homogeneous tissue, where that is known: blocks
// where there is more, dots and dashes where there is less.
std::string tactile_view(const TactileImage&);

// Shows them in one place of a terminal, or below each other where `in_place` is false.
class TactileScreen {
 public:
  explicit TactileScreen(bool in_place) : in_place_(in_place) {}
  // What to write for this image.
  std::string frame(const TactileImage&);

 private:
  bool in_place_;
  std::size_t lines_ = 0;  // of the image before
};

}  // namespace teletact::client
