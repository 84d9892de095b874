// A boxed device plugin with a fake of its maker's library, in the process that the box is.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include "client/haptic/plugin_device.h"
#include "tests/haptic/fake_device.h"

namespace teletact::client::test {

inline std::string built(const std::string& file) {
  const char* folder = std::getenv("TELETACT_BINARY_DIR");
  if (folder == nullptr) throw std::runtime_error("TELETACT_BINARY_DIR is not set; run the tests with ctest");
  return std::string(folder) + "/" + file;
}

inline bool comes(const std::function<bool()>& met, double within_s = 30) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(within_s);
  while (!met()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

// Gone, or waiting for somebody to ask how it ended.
inline bool has_ended(int process) {
  std::string word, state;
  std::ifstream status("/proc/" + std::to_string(process) + "/stat");
  return !(status >> word >> word >> state) || state == "Z";
}

struct Maker {
  std::string plugin, api, name, sdk;
  Matrix3 axes;  // from the scene's to the maker's
  double unit;   // of a metre
};

inline std::vector<Maker> makers() {
  Matrix3 dhd, hd;
  dhd << 0, 0, -1, 1, 0, 0, 0, -1, 0;  // x towards the operator, y right, z up
  hd << 1, 0, 0, 0, -1, 0, 0, 0, -1;   // x right, y up, z towards the operator
  return {{"force_dimension", "libdhd", "Force Dimension omega.3", "the Force Dimension SDK", dhd, 1},
          {"openhaptics", "libhd", "OpenHaptics Touch", "OpenHaptics", hd, 1000}};
}

class BoxedTest : public ::testing::TestWithParam<Maker> {
 protected:
  BoxedTest() : file_("/tmp/teletact-fake-device-" + std::to_string(::getpid())) {
    const int descriptor = ::open(file_.c_str(), O_RDWR | O_CREAT | O_TRUNC, 0600);
    if (descriptor < 0 || ::ftruncate(descriptor, sizeof(fake_device)) != 0) throw std::runtime_error(file_);
    fake = static_cast<fake_device*>(
        ::mmap(nullptr, sizeof(fake_device), PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0));
    ::close(descriptor);
    ::setenv(FAKE_DEVICE_VARIABLE, file_.c_str(), 1);
    put_hand({0.001, 0.002, 0.003});
  }
  ~BoxedTest() override {
    ::munmap(fake, sizeof(fake_device));
    ::unlink(file_.c_str());
  }

  std::string plugin() const { return built("client/" + GetParam().plugin + ".so"); }
  std::string library(const std::string& kind = "fake_") const {
    return "library=" + built("tests/" + kind + GetParam().api + ".so");
  }
  std::unique_ptr<PluginDevice> make(const std::string& more = "") const {
    return std::make_unique<PluginDevice>(plugin(), library() + more, start_m);
  }
  // What opening it says.
  std::string complaint(const std::string& settings) const {
    try {
      PluginDevice device(plugin(), settings, start_m);
      device.open();
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  }
  // Metres along the scene's axes, from the device's origin.
  void put_hand(const Vector3& scene_m, const Vector3& velocity_m_s = Vector3::Zero()) {
    const Vector3 at = GetParam().unit * (GetParam().axes * scene_m);
    const Vector3 moving = GetParam().unit * (GetParam().axes * velocity_m_s);
    for (int axis = 0; axis < 3; ++axis) fake->position[axis] = at[axis], fake->velocity[axis] = moving[axis];
  }
  // On the hand, as the fake was told last, along the scene's axes.
  Vector3 force_n() const {
    return GetParam().axes.transpose() * Vector3(fake->force[0], fake->force[1], fake->force[2]);
  }

  const Vector3 start_m{0.03, -0.005, 0.002};
  fake_device* fake = nullptr;

 private:
  std::string file_;
};

}  // namespace teletact::client::test
