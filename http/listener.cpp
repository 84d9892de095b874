#include "http/listener.h"

#include <netinet/in.h>
#include <sys/socket.h>

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
    ++open_;
    options_.take(std::move(socket), Place(this, [](Listener* from) { from->closed(); }));
    if (open_ < options_.most && !accepting_) accept();
  });
}

void Listener::closed() {
  --open_;
  if (!accepting_ && !stopping_) accept();
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
