#include "client/session/keyboard.h"

#include <poll.h>
#include <unistd.h>

namespace teletact::client {

Keyboard::Keyboard() {
  if (isatty(STDIN_FILENO) == 0 || tcgetpgrp(STDIN_FILENO) != getpgrp()) return;
  if (tcgetattr(STDIN_FILENO, &before_) != 0) return;
  restore_.emplace(
      [](void* of) noexcept { tcsetattr(STDIN_FILENO, TCSANOW, &static_cast<Keyboard*>(of)->before_); },
      this);
  termios keys = before_;
  keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);  // Ctrl-C stays a signal
  keys.c_cc[VMIN] = 1;
  keys.c_cc[VTIME] = 0;
  tcsetattr(STDIN_FILENO, TCSANOW, &keys);
}

Keyboard::~Keyboard() {
  give_back();
}

void Keyboard::give_back() noexcept {
  if (restore_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  restore_.reset();
}

char Keyboard::key() noexcept {
  if (!restore_) return 0;
  pollfd waiting{STDIN_FILENO, POLLIN, 0};
  if (poll(&waiting, 1, 0) <= 0) return 0;
  char key = 0;
  if (read(STDIN_FILENO, &key, 1) == 1) return key;
  give_back();  // the terminal is gone
  return 0;
}

}  // namespace teletact::client
