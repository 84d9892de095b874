#include "client/haptic/plugin_device.h"

#include <dlfcn.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace teletact::client {
namespace {

// As the C compiler lays out this version: a library with a shorter table lacks a function.
constexpr std::uint32_t kTableBytes = sizeof(teletact_device_plugin);

const teletact_device_plugin* checked(const teletact_device_plugin* plugin, const std::string& who) {
  if (plugin == nullptr) throw std::runtime_error(who + ": teletact_device_plugin_get() returned nothing");
  if (plugin->abi != TELETACT_DEVICE_ABI)
    throw std::runtime_error(who + " was built for version " + std::to_string(plugin->abi) +
                             " of teletact_device.h, this client has version " +
                             std::to_string(TELETACT_DEVICE_ABI) + "; build it again with this one's header");
  if (plugin->struct_bytes < kTableBytes || plugin->name == nullptr || plugin->open == nullptr ||
      plugin->read == nullptr || plugin->write == nullptr || plugin->close == nullptr)
    throw std::runtime_error(who +
                             ": its table lacks open, read, write, close or name; set struct_bytes to "
                             "sizeof(teletact_device_plugin) and fill in all of them");
  return plugin;
}

}  // namespace

PluginDevice::PluginDevice(const std::string& path, std::string settings, const Vector3& start_m)
    : path_(path), settings_(std::move(settings)), anchor_(start_m) {
  const std::string who = "device plugin '" + path + "'";
  // Absolute, or a plain name would be looked for among the system's libraries.
  library_ = dlopen(std::filesystem::absolute(path).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library_ == nullptr)
    throw std::runtime_error(who + " cannot be loaded: " + dlerror() +
                             "; check the path, and that what it links to is installed");
  try {
    using Get = const teletact_device_plugin* (*)();
    const auto get = reinterpret_cast<Get>(dlsym(library_, "teletact_device_plugin_get"));
    if (get == nullptr)
      throw std::runtime_error(who +
                               " is not a device plugin: it does not export teletact_device_plugin_get "
                               "(client/haptic/teletact_device.h)");
    plugin_ = checked(get(), who);
  } catch (...) {
    dlclose(library_);
    throw;
  }
}

PluginDevice::~PluginDevice() {
  close();
  dlclose(library_);
}

void PluginDevice::check(const teletact_device_limits& limits) const {
  const auto refuse = [&](const char* field, double value, const char* remedy) {
    std::ostringstream out;
    out << "device plugin '" << path_ << "': limits." << field << " is " << value << "; " << remedy;
    throw std::runtime_error(out.str());
  };
  const auto positive = [&](double value, const char* field) {
    if (!(value > 0) || value > 1e6) refuse(field, value, "state what the device's data sheet says");
  };
  positive(limits.largest_force_n, "largest_force_n");
  positive(limits.largest_stiffness_n_m, "largest_stiffness_n_m");
  positive(limits.largest_damping_n_s_m, "largest_damping_n_s_m");
  // The passivity controller counts on these two: none is safe, a number that is none is not.
  const auto not_negative = [&](double value, const char* field) {
    if (!(value >= 0) || value > 1e6) refuse(field, value, "give 0 if unknown");
  };
  not_negative(limits.friction_n, "friction_n");
  not_negative(limits.damping_n_s_m, "damping_n_s_m");
  if (!Vector3::Map(limits.workspace_centre_m).allFinite())
    throw std::runtime_error("device plugin '" + path_ +
                             "': limits.workspace_centre_m is not a number; give 0, 0, 0 if unknown");
}

void PluginDevice::open() {
  close();
  teletact_device_limits limits{};
  std::array<char, 512> error{};
  void* device = nullptr;
  if (plugin_->open(settings_.c_str(), &device, &limits, error.data(), error.size() - 1) != 0)
    throw std::runtime_error("device '" + std::string(plugin_->name) + "' (" + path_ + "): " +
                             (error[0] != '\0' ? error.data() : "cannot be opened, and says no more"));
  try {
    check(limits);
  } catch (...) {
    plugin_->close(device);
    throw;
  }
  device_ = device;
  let_go_ = false;
  anchor_.release();
  velocity_.restart();
  centre_m_ = Vector3::Map(limits.workspace_centre_m);
  profile_ = {plugin_->name,
              limits.largest_force_n,
              limits.largest_stiffness_n_m,
              limits.largest_damping_n_s_m,
              limits.workspace_radius_m,
              limits.apparent_mass_kg,
              limits.friction_n,
              limits.resolution_m,
              limits.damping_n_s_m};
}

void PluginDevice::close() noexcept {
  if (device_ != nullptr) plugin_->close(device_);
  device_ = nullptr;
}

template <typename Call>
int PluginDevice::timed(Call&& call) noexcept {
  const auto begin = std::chrono::steady_clock::now();
  const int code = call();
  const std::int64_t took_ns = (std::chrono::steady_clock::now() - begin).count();
  if (took_ns > longest_ns_) longest_ns_ = took_ns;
  return code;
}

bool PluginDevice::read(std::int64_t now_ns, DeviceReading& reading) noexcept {
  if (device_ == nullptr) return false;
  teletact_device_reading raw{};
  if (timed([&] { return plugin_->read(device_, now_ns, &raw); }) != 0) return false;
  const auto is_zero = [](const double(&xyz)[3]) { return xyz[0] == 0 && xyz[1] == 0 && xyz[2] == 0; };
  // What an adapter's memory holds before its device has said anything.
  if (!anchor_.held() && is_zero(raw.position_m)) return false;
  reading.pose.position_m = anchor_.to_scene(Vector3::Map(raw.position_m));
  const Vector3 derived_m_s = velocity_.at(reading.pose.position_m, now_ns);
  reading.velocity_stated = !is_zero(raw.velocity_m_s);
  reading.pose.velocity_m_s = reading.velocity_stated ? Vector3(Vector3::Map(raw.velocity_m_s)) : derived_m_s;
  reading.resume_pressed = raw.resume_pressed != 0;
  reading.buttons = raw.buttons;
  reading.held_at_border = false;
  return true;
}

bool PluginDevice::write(const Vector3& force_n) noexcept {
  if (device_ == nullptr || let_go_ || !force_n.allFinite()) return false;
  return timed([&] { return plugin_->write(device_, force_n.data()); }) == 0;
}

void PluginDevice::show_taxels(const TaxelView& view) noexcept {
  if (device_ == nullptr || plugin_->show_taxels == nullptr) return;
  const teletact_taxels taxels{
      static_cast<std::uint32_t>(view.along_x), static_cast<std::uint32_t>(view.along_z), view.pitch_m,
      view.pressure_pa.data(), view.beyond_pa.empty() ? nullptr : view.beyond_pa.data()};
  timed([&] {
    plugin_->show_taxels(device_, &taxels);
    return 0;
  });
}

std::string PluginDevice::trouble() {
  if (device_ == nullptr || plugin_->trouble == nullptr) return "";
  std::array<char, 256> text{};
  if (plugin_->trouble(device_, text.data(), text.size() - 1) == 0) return "";
  return "the device '" + profile_.name + "': " + text.data();
}

std::optional<Vector3> PluginDevice::workspace_centre_m() const noexcept {
  if (!(profile_.workspace_radius_m > 0)) return std::nullopt;
  return anchor_.place_of(centre_m_);
}

void PluginDevice::let_go() noexcept {
  let_go_ = true;
  if (device_ != nullptr && plugin_->let_go != nullptr) plugin_->let_go(device_);
}

}  // namespace teletact::client
