// The page, over HTTP and one WebSocket a viewer, to browsers of this machine that know the token. It is read
// only: all that a viewer says is what it has painted, and orders, where somebody takes them.
//
// A viewer has credit for one frame: the next one goes out when it has said that it painted the last, and
// holds the newest of each channel. So a hidden page, which paints nothing, gets nothing, and one that stalls
// queues nothing. Whose Host is not this machine's loopback, whose Origin is another page, or who lacks the
// token is refused.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "client/watch/view.h"

namespace teletact::client {

class Gateway {
 public:
  static constexpr std::size_t kMaxViewers = 16, kMaxConnections = 64;
  static constexpr std::size_t kMaxHeadBytes = 8192, kMaxSaidBytes = 512;  // of a message of a viewer
  static constexpr double kPatienceS = 5;  // for a request, and for an answer to be taken

  // What a viewer asks for beside looking: JSON, at most kMaxSaidBytes. On the gateway's thread.
  using Orders = std::function<void(const nlohmann::json&)>;

  // `port` of 127.0.0.1, 0 for any. Throws std::runtime_error, one line that names --port. Borrows the view.
  Gateway(unsigned port, View& view, Orders orders = {});
  ~Gateway();
  Gateway(const Gateway&) = delete;
  Gateway& operator=(const Gateway&) = delete;

  // With the token: whoever has it sees the session.
  const std::string& url() const;
  std::size_t viewers() const;

  struct State;  // of gateway.cpp alone

 private:
  std::unique_ptr<State> state_;
};

}  // namespace teletact::client
