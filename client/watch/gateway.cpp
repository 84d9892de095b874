#include "client/watch/gateway.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <list>
#include <random>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "client/watch/page.h"
#include "common/host.h"
#include "common/listener.h"

namespace teletact::client {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Protocol = Listener::Protocol;
using Stream = beast::basic_stream<Protocol>;
using Request = http::request<http::empty_body>;

constexpr auto kPatience = std::chrono::milliseconds(static_cast<int>(1e3 * Gateway::kPatienceS));
constexpr std::chrono::seconds kNoPingFor{30};  // of a viewer that answers no ping

std::string random_token() {
  std::random_device random;
  std::string out;
  for (int n = 0; n < 4; ++n) out += fmt::format("{:08x}", static_cast<std::uint32_t>(random()));
  return out;
}

// In a time that does not tell how much of it is right.
bool same(std::string_view one, std::string_view other) {
  if (one.size() != other.size()) return false;
  unsigned char differs = 0;
  for (std::size_t n = 0; n < one.size(); ++n) differs |= static_cast<unsigned char>(one[n] ^ other[n]);
  return differs == 0;
}

void be_nice() {
  constexpr int kNice = 5;
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice);
}

}  // namespace

class Viewer;

struct Gateway::State {
  View& view;
  Orders orders;
  std::string token = random_token(), url;
  std::list<std::weak_ptr<Viewer>> viewers;  // of the listener's thread
  std::atomic<std::size_t> count{0};
  std::atomic<bool> posted{false};
  std::unique_ptr<Listener> listener;

  void look();
};

// Ends itself: whatever is under way holds it.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  Viewer(Stream stream, Gateway::State& state, Listener::Place place)
      : place_(std::move(place)), stream_(std::move(stream)), state_(state) {
    ++state_.count;
  }
  ~Viewer() { --state_.count; }

  void begin(const Request& request) {
    beast::get_lowest_layer(stream_).expires_never();
    // One write a frame, that waits for nothing: with Nagle's algorithm the second waits 40 ms for an
    // acknowledgement. Of who has gone by now it fails, and reading tells.
    beast::error_code gone;
    beast::get_lowest_layer(stream_).socket().set_option(asio::ip::tcp::no_delay(true), gone);
    stream_.auto_fragment(false);
    stream_.set_option(websocket::stream_base::timeout{kPatience, kNoPingFor, true});
    stream_.read_message_max(Gateway::kMaxSaidBytes);
    stream_.binary(true);
    stream_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return;
      self->credit_ = true;
      self->read();
      self->show();
    });
  }
  // The newest, if the last was painted.
  void show() {
    if (!credit_) return;
    const auto slots = state_.view.news(seen_);
    if (slots.empty()) return;
    credit_ = false;
    frame_ = frame(++number_, slots);
    stream_.async_write(asio::buffer(frame_),
                        [self = shared_from_this()](beast::error_code error, std::size_t) {
                          if (error) self->over_ = true;
                          self->written_ = self->number_;
                          self->settle();
                        });
  }

 private:
  void read() {
    stream_.async_read(said_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) {
        self->over_ = true;
        return;
      }
      if (self->heed()) return self->read();
      self->over_ = true;
      self->stream_.async_close(websocket::close_code::policy_error, [self](beast::error_code) {});
    });
  }
  // False: it says what no page says.
  bool heed() {
    const std::string text = beast::buffers_to_string(said_.data());
    said_.clear();
    const nlohmann::json said = nlohmann::json::parse(text, nullptr, false);
    if (!said.is_object()) return false;
    if (const auto painted = said.find("painted"); painted != said.end()) {
      if (!painted->is_number_unsigned()) return false;
      painted_ = painted->get<std::uint64_t>();
      settle();
    } else if (state_.orders) {
      state_.orders(said);
    } else {
      return false;
    }
    return true;
  }
  void settle() {
    if (over_ || written_ != number_ || painted_ != number_) return;
    credit_ = true;
    show();
  }

  const Listener::Place place_;  // given up when the socket is closed
  websocket::stream<Stream> stream_;
  Gateway::State& state_;
  beast::flat_buffer said_{Gateway::kMaxSaidBytes + 64};
  std::string frame_;
  View::Seen seen_;
  std::uint32_t number_ = 0;
  std::uint64_t written_ = 0, painted_ = 0;
  bool credit_ = false, over_ = false;
};

void Gateway::State::look() {
  posted = false;
  for (auto at = viewers.begin(); at != viewers.end();) {
    const auto viewer = at->lock();
    if (viewer) viewer->show();
    at = viewer ? std::next(at) : viewers.erase(at);
  }
}

namespace {

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Protocol::socket socket, Gateway::State& state, Listener::Place place)
      : place_(std::move(place)), stream_(std::move(socket)), state_(state) {
    parser_.header_limit(Gateway::kMaxHeadBytes);
  }
  void begin() {
    stream_.expires_after(kPatience);
    place_->give_way = [this] { stream_.close(); };
    http::async_read_header(stream_, buffer_, parser_,
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error) self->serve();
                            });
  }

 private:
  void serve() {
    const Request& request = parser_.get();
    const std::string target(request.target());
    const std::string path = target.substr(0, target.find('?'));
    const std::size_t slash = path.find('/', 1);
    const std::string host(request[http::field::host]);
    if (const auto refusal = host_refusal(request))
      return answer(static_cast<http::status>(refusal->status), refusal->words);
    if (path.empty() || !same(std::string_view(path).substr(1, slash - 1), state_.token))
      return answer(http::status::forbidden, "open the address that was printed, with its token\n");
    place_->give_way = {};
    if (request.method() != http::verb::get) return answer(http::status::method_not_allowed, "GET alone\n");
    if (slash == std::string::npos) {  // the page's own links begin at its last slash
      response_.set(http::field::location, "/" + state_.token + "/");
      return answer(http::status::permanent_redirect, "the address ends with a slash\n");
    }
    const std::string name = path.substr(slash + 1);
    if (name == "live") return look(request, host);
    const auto file = page_file(name.empty() ? "index.html" : name);
    if (!file) return answer(http::status::not_found, "no such file\n");
    answer(http::status::ok, std::string(file->text), file->type);
  }
  void look(const Request& request, const std::string& host) {
    if (!websocket::is_upgrade(request)) return answer(http::status::bad_request, "a WebSocket\n");
    if (request[http::field::origin] != "http://" + host)
      return answer(http::status::forbidden, "Origin: another page's\n");
    if (state_.count >= Gateway::kMaxViewers)
      return answer(http::status::service_unavailable, "as many look as may\n");
    const auto viewer = std::make_shared<Viewer>(std::move(stream_), state_, place_);
    state_.viewers.push_back(viewer);
    viewer->begin(request);
  }
  void answer(http::status status, std::string text, const char* type = "text/plain; charset=utf-8") {
    response_.result(status);
    response_.set(http::field::content_type, type);
    response_.set(
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Opener-Policy", "same-origin");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    response_.set(http::field::cache_control, "no-store");
    response_.keep_alive(false);
    response_.body() = std::move(text);
    response_.prepare_payload();
    stream_.expires_after(kPatience);
    http::async_write(stream_, response_, [self = shared_from_this()](beast::error_code, std::size_t) {
      beast::error_code ignored;
      self->stream_.socket().shutdown(Protocol::socket::shutdown_both, ignored);
    });
  }

  const Listener::Place place_;
  Stream stream_;
  Gateway::State& state_;
  beast::flat_buffer buffer_{Gateway::kMaxHeadBytes};
  http::request_parser<http::empty_body> parser_;
  http::response<http::string_body> response_;
};

}  // namespace

Gateway::Gateway(unsigned port, View& view, Orders orders)
    : state_(new State{.view = view, .orders = std::move(orders), .url = {}, .viewers = {}, .listener = {}}) {
  State* const state = state_.get();
  try {
    state->listener = std::make_unique<Listener>(Listener::Options{
        .endpoint =
            asio::ip::tcp::endpoint(asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port)),
        .max = kMaxConnections,
        .take =
            [state](Protocol::socket socket, Listener::Place place) {
              std::make_shared<Connection>(std::move(socket), *state, std::move(place))->begin();
            },
        .begins = be_nice,
        .failed =
            [](const std::exception& error) { spdlog::error("the page's gateway: {}", error.what()); }});
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(fmt::format("--port {}: cannot listen there: {}", port, error.code().message()));
  }
  state->url = fmt::format("http://127.0.0.1:{}/{}/", state->listener->port(), state->token);
  view.on_change([state] {
    if (!state->posted.exchange(true)) asio::post(state->listener->io(), [state] { state->look(); });
  });
  state->listener->begin();
}

Gateway::~Gateway() {
  state_->view.on_change([] {});
  state_->listener->end();
  state_->listener.reset();
}

const std::string& Gateway::url() const {
  return state_->url;
}

std::size_t Gateway::viewers() const {
  return state_->count;
}

}  // namespace teletact::client
