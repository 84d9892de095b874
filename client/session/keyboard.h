// Single keys from the terminal, without waiting for a line: for an operator whose device has no button. The
// terminal is as it was before once this is gone, or the process ends in any other way but kill -9. Where
// stdin is no terminal, or another process is in its foreground, there are no keys.
#pragma once

#include <termios.h>

#include <optional>

#include "client/servo/ending.h"

namespace teletact::client {

class Keyboard {
 public:
  Keyboard();
  ~Keyboard();
  Keyboard(const Keyboard&) = delete;
  Keyboard& operator=(const Keyboard&) = delete;

  bool present() const noexcept { return restore_.has_value(); }
  // The next key that was pressed; 0: none was. Does not wait.
  char key() noexcept;

 private:
  void give_back() noexcept;

  termios before_{};
  std::optional<LastAct> restore_;
};

}  // namespace teletact::client
