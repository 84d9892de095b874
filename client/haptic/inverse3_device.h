// Haply Inverse3, through the Haply Inverse Service on its WebSocket.
//
// The connection lives on a thread of its own: the newest state comes to the servo and the newest force goes
// from it through slots of one, so that read() and write() neither wait nor allocate. When the servo stops
// writing for kForceLivesS, or the Inverse Service says nothing for kSilentS, the thread sends zero; when the
// connection is lost read() says so after kStaleS, and the thread connects again and sends zero first. A
// connection whose positions have all been (0, 0, 0) states none.
//
// Scene x is the device's x (right); scene y, into the tissue, is its z downwards; scene z is its y
// (forward).
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/haptic/anchor.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/latest_slot.h"

namespace teletact::client {

struct Inverse3Options {
  std::string url = "ws://localhost:10001";
  Vector3 start_m = Vector3::Zero();  // where in the scene the device stands at first
  double open_wait_s = 3;             // for the first position
};

class Inverse3Device final : public HapticDevice {
 public:
  static constexpr double kStaleS = 0.1;
  static constexpr double kForceLivesS = 0.01;
  static constexpr double kSilentS = 0.05;

  // Throws std::invalid_argument when the address is none.
  explicit Inverse3Device(const Inverse3Options& options);
  ~Inverse3Device() override;
  Inverse3Device(const Inverse3Device&) = delete;
  Inverse3Device& operator=(const Inverse3Device&) = delete;

  // The limits are ours, cautious ones (the maker's tutorials go up to 400 N/m): not a data sheet's.
  const DeviceProfile& profile() const noexcept override;
  void open() override;
  void close() noexcept override;
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void let_go() noexcept override { let_go_ = true; }  // its thread sends it

 private:
  struct State {
    Vector3 position_m = Vector3::Zero();  // scene axes, device origin
    Vector3 velocity_m_s = Vector3::Zero();
    std::optional<Eigen::Vector4d> orientation;  // of the grip
    bool pressed = false;
    std::int64_t received_ns = 0;
  };
  struct Force {
    Vector3 force_n = Vector3::Zero();
    std::int64_t written_ns = 0;
  };
  class Connection;

  void run();
  void exchange(Connection& connection);
  void tell(const std::string& trouble);

  Inverse3Options options_;
  Anchor anchor_;
  LatestSlot<State> states_;
  LatestSlot<Force> forces_;
  State state_;               // the servo's
  std::int64_t read_ns_ = 0;  // the servo's time of the last read
  std::atomic<bool> stop_{false};
  std::atomic<bool> let_go_{false};

  std::mutex mutex_;  // of the two below, between open() and the thread
  std::condition_variable changed_;
  bool heard_ = false;
  std::string trouble_;
  std::thread thread_;
};

}  // namespace teletact::client
