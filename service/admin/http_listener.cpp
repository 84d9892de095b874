#include "service/admin/http_listener.h"

#include <fmt/format.h>
#include <netinet/in.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>

#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/generic/stream_protocol.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <thread>
#include <utility>

#include "service/rpc/address.h"
#include "service/scene/niced_worker.h"

namespace teletact::service {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Protocol = asio::generic::stream_protocol;
using Acceptor = asio::basic_socket_acceptor<Protocol>;
using Stream = beast::basic_stream<Protocol>;

constexpr auto kPatience = std::chrono::duration_cast<std::chrono::milliseconds>(
    std::chrono::duration<double>(HttpListener::kPatienceS));
constexpr int kWaiting = 128;                           // connections, in the system's queue
constexpr std::chrono::milliseconds kRetryAccept{100};  // where the system has no more descriptors

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
    answer = get ? answers(target.substr(0, target.find('?')))
                 : HttpListener::Answer{405, "GET alone is answered\n"};
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
  Connection(Protocol::socket socket, const HttpListener::Answers& answers, std::function<void()> closed)
      : stream_(std::move(socket)), answers_(answers), closed_(std::move(closed)) {
    parser_.header_limit(HttpListener::kMostHeadBytes);
  }
  ~Connection() { closed_(); }

  void begin() {
    stream_.expires_after(kPatience);
    http::async_read_header(stream_, buffer_, parser_,
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error) self->answer();
                            });
  }

 private:
  void answer() {
    response_ = respond(parser_.get(), answers_);
    stream_.expires_after(kPatience);
    http::async_write(stream_, response_, [self = shared_from_this()](beast::error_code, std::size_t) {
      beast::error_code ignored;
      self->stream_.socket().shutdown(Protocol::socket::shutdown_both, ignored);
    });
  }

  Stream stream_;
  beast::flat_buffer buffer_{HttpListener::kMostHeadBytes};
  http::request_parser<http::empty_body> parser_;
  http::response<http::string_body> response_;
  const HttpListener::Answers& answers_;
  const std::function<void()> closed_;
};

}  // namespace

struct HttpListener::State {
  explicit State(Answers answer) : answers(std::move(answer)) {}

  void accept() {
    accepting = true;
    acceptor.async_accept([this](beast::error_code error, Protocol::socket socket) {
      accepting = false;
      if (error == asio::error::operation_aborted) return;
      if (error) return accept_later();
      const auto connection = std::make_shared<Connection>(std::move(socket), answers, [this] { closed(); });
      ++open;
      connection->begin();
      if (open < kMostConnections) accept();
    });
  }
  void closed() {
    --open;
    if (!accepting && !stopping) accept();
  }
  void accept_later() {
    accepting = true;
    retry.expires_after(kRetryAccept);
    retry.async_wait([this](beast::error_code error) {
      if (!error) accept();
    });
  }

  // Where there is no memory for one connection, others come.
  void serve() {
    be_nice();
    while (!io.stopped()) try {
        io.run();
      } catch (const std::exception& error) {
        spdlog::error("event=admin_failed error=\"{}\"", error.what());
        if (!accepting) accept_later();
      }
  }

  Answers answers;
  std::size_t open = 0;
  bool accepting = false, stopping = false;
  std::string socket;  // the path of a Unix socket, removed at the end
  asio::io_context io{1};
  Acceptor acceptor{io};
  asio::steady_timer retry{io};
  std::thread thread;
};

HttpListener::HttpListener(const char* flag, const std::string& address, Answers answers)
    : address_(address), state_(std::make_unique<State>(std::move(answers))) {
  const Address local = prepare_local_address(flag, address);
  try {
    const Protocol::endpoint endpoint = endpoint_of(local);
    state_->acceptor.open(endpoint.protocol());
    if (local.socket.empty()) state_->acceptor.set_option(asio::socket_base::reuse_address(true));
    state_->acceptor.bind(endpoint);
    state_->acceptor.listen(kWaiting);
    state_->socket = local.socket;
    if (local.socket.empty()) {
      const auto bound = state_->acceptor.local_endpoint();
      address_ = address.substr(0, address.rfind(':') + 1) +
                 std::to_string(ntohs(reinterpret_cast<const sockaddr_in*>(bound.data())->sin_port));
    }
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(
        fmt::format("{} {}: cannot listen there: {}", flag, address, error.code().message()));
  }
  state_->accept();
  state_->thread = std::thread([state = state_.get()] { state->serve(); });
}

HttpListener::~HttpListener() {
  state_->io.stop();
  state_->thread.join();
  state_->stopping = true;  // connections end with the context
  std::error_code ignored;
  if (!state_->socket.empty()) std::filesystem::remove(state_->socket, ignored);
}

}  // namespace teletact::service
