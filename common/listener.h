// Accepts connections of this machine, so many at once, and serves them on one thread. While as many are
// open, the oldest of those that may give way is closed for the next one; where none may, others wait in the
// system's queue. What is said over them is others' matter.
#pragma once

#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/generic/stream_protocol.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace teletact {

class Listener {
 public:
  using Protocol = boost::asio::generic::stream_protocol;
  // Whoever holds it keeps a connection's place. While `give_way` is there, it may be called: it closes the
  // connection. Whoever has not shown yet that it may be here gives way.
  struct Seat {
    std::function<void()> give_way = {};
  };
  using Place = std::shared_ptr<Seat>;
  struct Options {
    Protocol::endpoint endpoint;
    std::size_t max = 8;  // open at once
    // On the thread. A connection must hold its place, and nothing of it may outlive this.
    std::function<void(Protocol::socket, Place)> take;
    std::function<void()> begins = [] {};  // first
    std::function<void(const std::exception&)> failed = [](auto&) {
    };  // where there is no memory: others come
  };

  // Throws boost::system::system_error when it cannot listen there. Serves from begin() on.
  explicit Listener(Options options);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  void begin();
  void end();                  // joins the thread; connections end with this
  std::uint16_t port() const;  // in use; of TCP alone
  boost::asio::io_context& io() { return io_; }

 private:
  void accept();
  void go_on();
  void take(Protocol::socket);
  void accept_later();
  void serve();

  Options options_;
  std::vector<Seat*> seats_;  // as they came
  bool accepting_ = false, stopping_ = false;
  boost::asio::io_context io_{1};
  boost::asio::basic_socket_acceptor<Protocol> acceptor_{io_};
  boost::asio::steady_timer retry_{io_};
  std::optional<Protocol::socket> next_;  // that came, and has no place yet
  std::thread thread_;
};

}  // namespace teletact
