#include "service/operation/http_listener.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include "common/host.h"
#include "common/listener.h"
#include "service/rpc/address.h"
#include "service/scene/workers.h"

namespace teletact::service {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Protocol = Listener::Protocol;
using Stream = beast::basic_stream<Protocol>;

Protocol::endpoint endpoint_of(const Address& address) {
  if (!address.socket.empty()) return asio::local::stream_protocol::endpoint(address.socket);
  return asio::ip::tcp::endpoint(asio::ip::make_address(address.host), address.port);
}

http::response<http::string_body> respond(const http::request<http::empty_body>& request,
                                          const HttpListener::Answers& answers) {
  HttpListener::Answer answer;
  const bool get = request.method() == http::verb::get || request.method() == http::verb::head;
  const std::string target(request.target());
  try {
    if (const auto refusal = host_refusal(request))
      answer = {refusal->status, refusal->words};
    else if (get)
      answer = answers(target.substr(0, target.find('?')));
    else
      answer = {405, "GET alone is answered\n"};
  } catch (const std::exception& error) {
    answer = {500, std::string(error.what()) + "\n"};
  }
  http::response<http::string_body> response(static_cast<http::status>(answer.status), 11);
  if (!get) response.set(http::field::allow, "GET, HEAD");
  response.set(http::field::content_type, answer.type);
  response.keep_alive(false);
  response.content_length(answer.text.size());
  if (request.method() != http::verb::head) response.body() = std::move(answer.text);
  return response;
}

// Ends itself: whatever is under way holds it.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Protocol::socket socket, const HttpListener::Answers& answers, double patience_s,
             Listener::Place place)
      : place_(std::move(place)),
        stream_(std::move(socket)),
        answers_(answers),
        patience_(std::chrono::duration_cast<std::chrono::milliseconds>(
            std::chrono::duration<double>(patience_s))) {
    parser_.header_limit(HttpListener::kMaxHeadBytes);
  }

  void begin() {
    stream_.expires_after(patience_);
    place_->give_way = [this] { stream_.close(); };
    http::async_read_header(stream_, buffer_, parser_,
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error) self->answer();
                            });
  }

 private:
  void answer() {
    place_->give_way = {};
    response_ = respond(parser_.get(), answers_);
    stream_.expires_after(patience_);
    http::async_write(stream_, response_, [self = shared_from_this()](beast::error_code, std::size_t) {
      beast::error_code ignored;
      self->stream_.socket().shutdown(Protocol::socket::shutdown_both, ignored);
    });
  }

  const Listener::Place place_;  // given up when the socket is closed
  Stream stream_;
  beast::flat_buffer buffer_{HttpListener::kMaxHeadBytes};
  http::request_parser<http::empty_body> parser_;
  http::response<http::string_body> response_;
  const HttpListener::Answers& answers_;
  const std::chrono::milliseconds patience_;
};

}  // namespace

struct HttpListener::State {
  Answers answers;
  double patience_s;
  std::string socket;  // the path of a Unix socket, removed at the end
  std::shared_ptr<void> held;
  std::unique_ptr<Listener> listener;
};

HttpListener::HttpListener(const char* flag, const std::string& address, Answers answers, double patience_s)
    : address_(address), state_(std::make_unique<State>()) {
  state_->answers = std::move(answers);
  state_->patience_s = patience_s;
  const Address local = prepare_local_address(flag, address);
  try {
    state_->listener = std::make_unique<Listener>(
        Listener::Options{.endpoint = endpoint_of(local),
                          .max = kMaxConnections,
                          .take =
                              [state = state_.get()](Protocol::socket socket, Listener::Place place) {
                                std::make_shared<Connection>(std::move(socket), state->answers,
                                                             state->patience_s, std::move(place))
                                    ->begin();
                              },
                          .begins = be_nice,
                          .failed =
                              [](const std::exception& error) {
                                spdlog::error("event=admin_failed error=\"{}\"", error.what());
                              }});
    state_->socket = local.socket;
    state_->held = local.held;
    if (local.socket.empty())
      address_ = address.substr(0, address.rfind(':') + 1) + std::to_string(state_->listener->port());
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(
        fmt::format("{} {}: cannot listen there: {}", flag, address, error.code().message()));
  }
  state_->listener->begin();
}

HttpListener::~HttpListener() {
  state_->listener.reset();
  std::error_code ignored;
  if (!state_->socket.empty()) std::filesystem::remove(state_->socket, ignored);
}

}  // namespace teletact::service
