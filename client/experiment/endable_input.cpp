#include "client/experiment/endable_input.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>

namespace teletact::client {

EndableInput::int_type EndableInput::underflow() {
  constexpr int kLookAgainMs = 20;  // whether to end
  while (!end_) {
    pollfd waiting{descriptor_, POLLIN, 0};
    const int ready = poll(&waiting, 1, kLookAgainMs);
    if (ready == 0 || (ready < 0 && errno == EINTR)) continue;
    const ssize_t bytes = ready < 0 ? -1 : read(descriptor_, text_.data(), text_.size());
    if (bytes < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (bytes <= 0) break;
    setg(text_.data(), text_.data(), text_.data() + bytes);
    return traits_type::to_int_type(text_.front());
  }
  return traits_type::eof();
}

}  // namespace teletact::client
