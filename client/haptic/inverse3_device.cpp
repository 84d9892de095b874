#include "client/haptic/inverse3_device.h"

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <functional>
#include <optional>
#include <stdexcept>

#include "client/clock/clock.h"
#include "client/haptic/inverse3_protocol.h"

namespace teletact::client {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

constexpr std::chrono::milliseconds kHandshake{1000}, kIdle{300}, kRetry{200};
constexpr std::chrono::microseconds kExchange{500};  // a new force reaches the device this soon, at most

Eigen::Vector3d to_device(const Vector3& scene) {
  return {scene.x(), scene.z(), -scene.y()};
}

Vector3 to_scene(const Eigen::Vector3d& device) {
  return {device.x(), -device.z(), device.y()};
}

}  // namespace

// One connection; every call waits for a stated time at most and throws std::exception when it fails.
class Inverse3Device::Connection {
 public:
  explicit Connection(const WebSocketUrl& url) : socket_(context_) {
    tcp::resolver resolver(context_);
    const auto found = resolver.resolve(url.host, url.port);
    auto& stream = beast::get_lowest_layer(socket_);
    stream.expires_after(kHandshake);
    wait([&](auto done) { stream.async_connect(found, [done](auto error, const auto&) { done(error); }); });
    stream.expires_never();
    stream.socket().set_option(tcp::no_delay(true));
    socket_.set_option(websocket::stream_base::timeout{kHandshake, kIdle, false});
    wait([&](auto done) { socket_.async_handshake(url.host + ":" + url.port, url.path, done); });
    socket_.text(true);
  }

  // `late` is called once when nothing has come for `patience`; it may write.
  std::string read(std::chrono::duration<double> patience, const std::function<void()>& late) {
    beast::flat_buffer buffer;
    std::optional<beast::error_code> result;
    socket_.async_read(buffer, [&](beast::error_code error, std::size_t) { result = error; });
    context_.restart();
    const auto until = std::chrono::steady_clock::now() + patience;
    while (!result && std::chrono::steady_clock::now() < until)
      context_.run_one_until(std::chrono::time_point_cast<std::chrono::steady_clock::duration>(until));
    if (!result) late();
    finish(result);
    return beast::buffers_to_string(buffer.data());
  }
  void write(const std::string& text) {
    wait([&](auto done) {
      socket_.async_write(asio::buffer(text), [done](auto error, std::size_t) { done(error); });
    });
  }
  void close() {
    wait([&](auto done) { socket_.async_close(websocket::close_code::normal, done); });
  }

 private:
  // Beast's timeouts end the operation. Its timer stays behind as work, so the context never runs dry.
  template <typename Start>
  void wait(Start&& start) {
    std::optional<beast::error_code> result;
    start([&](beast::error_code error) { result = error; });
    finish(result);
  }
  void finish(const std::optional<beast::error_code>& result) {
    context_.restart();
    while (!result) context_.run_one();
    if (*result) throw beast::system_error(*result);
  }

  asio::io_context context_;
  websocket::stream<beast::tcp_stream> socket_;
};

Inverse3Device::Inverse3Device(const Inverse3Options& options) : options_(options), anchor_(options.start_m) {
  parse_websocket_url(options_.url);
}

Inverse3Device::~Inverse3Device() {
  close();
}

const DeviceProfile& Inverse3Device::profile() const noexcept {
  // name, N, N/m, N s/m, workspace m; mass, friction and resolution are not known, and not counted on.
  static const DeviceProfile profile{"inverse3", 4, 400, 4, 0.1, 0, 0, 0, 0};
  return profile;
}

void Inverse3Device::open() {
  close();
  stop_ = false;
  let_go_ = false;
  heard_ = false;
  trouble_ = "it says nothing";
  anchor_.release();
  thread_ = std::thread([this] { run(); });
  std::unique_lock lock(mutex_);
  const auto wait = std::chrono::duration<double>(options_.open_wait_s);
  if (changed_.wait_for(lock, wait, [this] { return heard_; })) return;
  const std::string trouble = trouble_;
  lock.unlock();
  close();
  throw std::runtime_error(
      "no Inverse3 at " + options_.url + ": " + trouble +
      "; start the Haply Inverse Service there (Haply Hub), or give another address with "
      "--device inverse3:ws://HOST:PORT");
}

void Inverse3Device::close() noexcept {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

bool Inverse3Device::read(std::int64_t, DeviceReading& reading) noexcept {
  read_ns_ = monotonic_ns();
  states_.take(state_);
  // Stale by the clock that stamped it, whatever clock the servo runs on.
  if (static_cast<double>(read_ns_ - state_.received_ns) > kStaleS * 1e9) return false;
  reading.pose.position_m = anchor_.to_scene(state_.position_m);
  reading.pose.velocity_m_s = state_.velocity_m_s;
  reading.velocity_stated = true;
  reading.orientation = state_.orientation;
  reading.resume_pressed = state_.pressed;
  reading.buttons = state_.pressed ? 1 : 0;
  reading.held_at_border = false;
  return true;
}

bool Inverse3Device::write(const Vector3& force_n) noexcept {
  if (let_go_ || !force_n.allFinite()) return false;
  forces_.put({force_n, read_ns_});
  return true;
}

void Inverse3Device::tell(const std::string& trouble) {
  const std::lock_guard lock(mutex_);
  trouble_ = trouble;
}

void Inverse3Device::run() {
  const WebSocketUrl url = parse_websocket_url(options_.url);
  while (!stop_) {
    try {
      Connection connection(url);
      exchange(connection);
    } catch (const std::exception& error) {
      tell(error.what());
    }
    if (!stop_) std::this_thread::sleep_for(kRetry);
  }
}

// State in, force out, in turns. The first force of a connection is zero, whatever the servo says; so is the
// last, also of one that ends because the service talks nonsense.
void Inverse3Device::exchange(Connection& connection) {
  Force force;
  std::string device_id;
  bool sent_early = false;  // zero, before the state came: this turn's force
  bool stands = false;      // somewhere: (0, 0, 0) before any other is what is there before the device speaks
  const auto send = [&](const Vector3& force_n, bool first) {
    connection.write(inverse3_command(device_id, to_device(force_n), first));
  };
  const auto let_go = [&] {
    if (!device_id.empty()) send(Vector3::Zero(), false);
    sent_early = !device_id.empty();
  };
  const auto read = [&] {
    sent_early = false;
    const std::string message = connection.read(std::chrono::duration<double>(kSilentS), let_go);
    try {
      return parse_inverse3(message);
    } catch (const std::exception&) {
      let_go();
      throw;
    }
  };
  auto due = std::chrono::steady_clock::now();
  for (bool first = true; true; first = false) {
    const Inverse3State received = read();
    device_id = received.device_id;
    const bool first_place = !stands && !received.position_m.isZero(0);
    stands = stands || first_place;
    if (stands)
      states_.put({to_scene(received.position_m), to_scene(received.velocity_m_s), received.orientation,
                   received.pressed, monotonic_ns()});
    else
      tell("it states no position yet; calibrate it");
    if (first_place) {  // open() returns now, and the first read() finds it
      const std::lock_guard lock(mutex_);
      heard_ = true;
      changed_.notify_all();
    }
    due = std::max(due + kExchange, std::chrono::steady_clock::now());
    std::this_thread::sleep_until(due);
    forces_.take(force);
    const bool stopping = stop_;
    const bool lives = !first && !stopping && !let_go_ && stands &&
                       static_cast<double>(monotonic_ns() - force.written_ns) < kForceLivesS * 1e9;
    if (!sent_early) send(lives ? force.force_n : Vector3(Vector3::Zero()), first);
    if (stopping) break;
  }
  connection.close();
}

}  // namespace teletact::client
