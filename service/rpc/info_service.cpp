#include "service/rpc/info_service.h"

namespace teletact::service {

grpc::Status InfoService::GetInfo(grpc::ServerContext*, const v1::GetInfoRequest*,
                                  v1::GetInfoResponse* response) {
  response->set_api_version("v1");
  response->set_build(TELETACT_VERSION);
  response->set_instance(core_.instance);
  const DeviceInfo& device = core_.device->info();
  v1::Device* out = response->mutable_device();
  out->set_name(device.name);
  out->set_vendor(device.vendor);
  out->set_platform(device.platform);
  out->set_driver_version(device.driver_version);
  out->set_has_double(device.has_double);
  out->set_compute_units(device.compute_units);
  out->set_global_memory_bytes(device.global_memory_bytes);
  const auto limit = [response](const char* name, double value, const char* unit) {
    v1::Limit* added = response->add_limits();
    added->set_name(name);
    added->set_value(value);
    added->set_unit(unit);
  };
  limit("most_frame_bytes", static_cast<double>(Core::kMostFrameBytes), "B");
  limit("most_scene_elements", static_cast<double>(core_.scenes.limits().most_elements), "1");
  limit("most_scenes", static_cast<double>(core_.scenes.limits().most_scenes), "1");
  limit("most_touch_rate_hz", Core::kMostTouchesPerSecond, "Hz");
  response->set_uptime_ns(
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - core_.started)
          .count());
  return grpc::Status::OK;
}

}  // namespace teletact::service
