#include "common/listener.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <chrono>
#include <utility>

namespace teletact {
namespace {

constexpr int kWaiting = 128;                           // connections, in the system's queue
constexpr std::chrono::milliseconds kRetryAccept{100};  // where the system has no more descriptors

}  // namespace

Listener::Listener(Options options) : options_(std::move(options)) {
  acceptor_.open(options_.endpoint.protocol());
  if (options_.endpoint.protocol().family() != AF_UNIX)
    acceptor_.set_option(boost::asio::socket_base::reuse_address(true));
  acceptor_.bind(options_.endpoint);
  acceptor_.listen(kWaiting);
}

Listener::~Listener() {
  end();
}

std::uint16_t Listener::port() const {
  const auto bound = acceptor_.local_endpoint();
  return ntohs(reinterpret_cast<const sockaddr_in*>(bound.data())->sin_port);
}

void Listener::begin() {
  accept();
  thread_ = std::thread([this] { serve(); });
}

void Listener::end() {
  io_.stop();
  if (thread_.joinable()) thread_.join();
  stopping_ = true;  // connections end with the context
}

void Listener::accept() {
  accepting_ = true;
  acceptor_.async_accept([this](boost::system::error_code error, Protocol::socket socket) {
    accepting_ = false;
    if (error == boost::asio::error::operation_aborted) return;
    if (error) return accept_later();
    next_ = std::move(socket);
    go_on();
  });
}

void Listener::go_on() {
  if (stopping_) return;
  if (next_) {
    if (seats_.size() >= options_.max) {
      const auto oldest = std::ranges::find_if(seats_, [](Seat* seat) { return bool(seat->give_way); });
      if (oldest == seats_.end()) return;  // until one is closed
      std::exchange((*oldest)->give_way, {})();
    }
    take(*std::exchange(next_, std::nullopt));
  }
  if (!accepting_) accept();
}

void Listener::take(Protocol::socket socket) {
  const Place place(new Seat, [this](Seat* seat) {
    std::erase(seats_, seat);
    delete seat;
    go_on();
  });
  seats_.push_back(place.get());
  options_.take(std::move(socket), place);
}

void Listener::accept_later() {
  accepting_ = true;
  retry_.expires_after(kRetryAccept);
  retry_.async_wait([this](boost::system::error_code error) {
    if (!error) accept();
  });
}

void Listener::serve() {
  options_.begins();
  while (!io_.stopped()) try {
      io_.run();
    } catch (const std::exception& error) {
      options_.failed(error);
      if (!accepting_) accept_later();
    }
}

}  // namespace teletact
