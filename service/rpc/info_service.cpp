#include "service/rpc/info_service.h"

#include <algorithm>

#include "service/rpc/unary_call.h"

namespace teletact::service {

namespace {

void device_to(const DeviceInfo& device, v1::Device* out) {
  out->set_name(device.name);
  out->set_vendor(device.vendor);
  out->set_platform(device.platform);
  out->set_driver_version(device.driver_version);
  out->set_has_double(device.has_double);
  out->set_compute_units(device.compute_units);
  out->set_global_memory_bytes(device.global_memory_bytes);
}

}  // namespace

grpc::ServerUnaryReactor* InfoService::GetInfo(grpc::CallbackServerContext* context,
                                               const v1::GetInfoRequest*, v1::GetInfoResponse* response) {
  return UnaryCall::serve(
      core_, context, {"teletact.v1.Info/GetInfo", CallKind::kInfo, {Need::kKnown, ""}},
      [=, this](const UnaryCall::Handle& call) { call->answer(*response, [&] { describe(response); }); });
}

void InfoService::describe(v1::GetInfoResponse* response) const {
  response->set_api_version("v1");
  response->set_build(TELETACT_VERSION);
  response->set_instance(core_.instance);
  for (const CurrentDevice& device : core_.devices) device_to(device->info(), response->add_devices());
  *response->mutable_device() = response->devices(0);
  for (const LimitRow& row : limit_rows()) {
    v1::Limit* limit = response->add_limits();
    limit->set_name(row.name);
    limit->set_value(row.value(core_.limits));
    limit->set_unit(row.unit);
  }
  std::vector<MemoryUse> uses = core_.memory->uses();
  // A place that holds nothing says so: silence would leave open whether the service tells at all.
  std::vector<Place> places{Place::kHost};
  for (std::size_t k = 0; k < core_.devices.size(); ++k) places.push_back(place_of_device(k));
  for (const Place place : places)
    if (std::none_of(uses.begin(), uses.end(), [&](const auto& use) { return use.place == place; }))
      uses.push_back({place, "", 0});
  for (const MemoryUse& use : uses) {
    v1::MemoryUse* held = response->add_memory();
    held->set_place(name_of(use.place));
    held->set_kind(use.kind);
    held->set_bytes(use.bytes);
  }
  response->set_uptime_ns(
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - core_.started)
          .count());
}

}  // namespace teletact::service
