// Stands in for the Haply Inverse Service: an inventory on connecting, then one state for each message, as
// the maker documents it. One connection at a time; the cursor stands where the test puts it.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>

#include <Eigen/Core>
#include <atomic>
#include <cmath>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

namespace teletact::client::test {

class Inverse3Service {
 public:
  // Port 0: one that is free. The cursor at (0, 0, 0): its device has not spoken yet.
  explicit Inverse3Service(int port = 0, const Eigen::Vector3d& cursor_m = {0.01, -0.12, 0.15})
      : acceptor_(context_), position_m_(cursor_m) {
    const boost::asio::ip::tcp::endpoint endpoint(boost::asio::ip::address_v4::loopback(),
                                                  static_cast<unsigned short>(port));
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(boost::asio::socket_base::reuse_address(true));
    acceptor_.bind(endpoint);
    acceptor_.listen();
    this->port = acceptor_.local_endpoint().port();
    thread_ = std::thread([this] { run(); });
  }
  ~Inverse3Service() {
    stop_ = true;
    {
      const std::lock_guard lock(mutex_);
      if (socket_ != nullptr) ::shutdown(socket_->native_handle(), SHUT_RDWR);
    }
    ::shutdown(acceptor_.native_handle(), SHUT_RDWR);
    thread_.join();
  }
  std::string url() const { return "ws://127.0.0.1:" + std::to_string(port); }

  void put_cursor(const Eigen::Vector3d& position_m, const Eigen::Vector3d& velocity_m_s) {
    const std::lock_guard lock(mutex_);
    position_m_ = position_m;
    velocity_m_s_ = velocity_m_s;
  }
  Eigen::Vector3d force_n() {
    const std::lock_guard lock(mutex_);
    return force_n_;
  }
  // The largest force that a connection began with.
  double largest_first_n() {
    const std::lock_guard lock(mutex_);
    return largest_first_n_;
  }
  nlohmann::json first_command() {
    const std::lock_guard lock(mutex_);
    return first_command_;
  }

  int port = 0;
  std::atomic<bool> pressed{false};
  std::atomic<bool> has_device{true};
  std::atomic<bool> garbage{false};  // says what is no JSON
  std::atomic<bool> silent{false};   // takes messages, says nothing
  std::atomic<double> noise_m{0};    // of the cursor, as no hand holds still to the last bit
  std::atomic<bool> turns{false};    // the grip, by 0.01 with each message
  std::atomic<unsigned> messages{0};
  std::atomic<unsigned> connections{0};

 private:
  using Socket = boost::asio::ip::tcp::socket;
  static nlohmann::json json_of(const Eigen::Vector3d& v) {
    return {{"x", v.x()}, {"y", v.y()}, {"z", v.z()}};
  }

  std::string state(bool inventory) {
    const std::lock_guard lock(mutex_);
    if (garbage) return "no json {";
    const Eigen::Vector3d noise(0, 0, noise_m * std::sin(++states_));
    nlohmann::json message = {{"inverse3", nlohmann::json::array()}};
    if (has_device) {
      nlohmann::json device = {{"device_id", "049D"},
                               {"state",
                                {{"cursor_position", json_of(position_m_ + noise)},
                                 {"cursor_velocity", json_of(velocity_m_s_)},
                                 {"control_mode", "cursor_force"}}},
                               {"status", {{"calibrated", true}, {"ready", true}}}};
      if (inventory) device["config"] = {{"type", "inverse3"}, {"handedness", "right"}};
      message["inverse3"].push_back(device);
    }
    message["wireless_verse_grip"] = nlohmann::json::array(
        {{{"device_id", "61548"},
          {"state",
           {{"buttons", {{"a", pressed.load()}, {"b", false}, {"c", false}}},
            {"hall", 3},
            {"orientation",
             {{"w", std::cos(angle_ / 2)}, {"x", 0.0}, {"y", 0.0}, {"z", std::sin(angle_ / 2)}}}}}}});
    if (turns) angle_ += 0.01;
    return message.dump();
  }

  void take(const std::string& text) {
    const nlohmann::json command = nlohmann::json::parse(text);
    const nlohmann::json& device = command.at("inverse3").at(0);
    if (device.at("device_id") != "049D") throw std::runtime_error("another device");
    const nlohmann::json& values = device.at("commands").at("set_cursor_force").at("values");
    const std::lock_guard lock(mutex_);
    if (first_command_.is_null()) first_command_ = command;
    force_n_ << values.at("x").get<double>(), values.at("y").get<double>(), values.at("z").get<double>();
    if (first_of_connection_) largest_first_n_ = std::max(largest_first_n_, force_n_.norm());
    first_of_connection_ = false;
    ++messages;
  }

  void serve(Socket& socket) {
    boost::beast::websocket::stream<Socket&> stream(socket);
    stream.accept();
    stream.text(true);
    ++connections;
    bool inventory = true;
    {
      const std::lock_guard lock(mutex_);
      first_of_connection_ = true;
    }
    while (!stop_) {
      if (!silent || inventory) stream.write(boost::asio::buffer(state(inventory)));
      inventory = false;
      boost::beast::flat_buffer buffer;
      stream.read(buffer);
      take(boost::beast::buffers_to_string(buffer.data()));
    }
  }

  void run() {
    while (!stop_) {
      boost::system::error_code error;
      Socket socket(context_);
      acceptor_.accept(socket, error);
      if (error) continue;
      {
        const std::lock_guard lock(mutex_);
        socket_ = &socket;
      }
      try {
        serve(socket);
      } catch (const std::exception&) {  // the client has gone
      }
      const std::lock_guard lock(mutex_);
      socket_ = nullptr;
    }
  }

  boost::asio::io_context context_;
  boost::asio::ip::tcp::acceptor acceptor_;
  std::mutex mutex_;
  Socket* socket_ = nullptr;
  Eigen::Vector3d position_m_, velocity_m_s_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_n_ = Eigen::Vector3d::Zero();
  nlohmann::json first_command_;
  bool first_of_connection_ = true;
  double angle_ = 0.3, states_ = 0;
  double largest_first_n_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace teletact::client::test
