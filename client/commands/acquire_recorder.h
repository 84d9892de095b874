// Everything that the recording of an acquisition gets, in one place; calls come from several threads.
#pragma once

#include <cstdint>
#include <ctime>
#include <optional>
#include <string>
#include <utility>

#include "client/clock/clock.h"
#include "client/link/recording.h"
#include "teletact/v1/elastography.pb.h"
#include "teletact/v1/info.pb.h"

namespace teletact::client {

class AcquireRecorder {
 public:
  // `path`: empty: nothing is kept. Throws as RecordWriter does.
  AcquireRecorder(const std::string& path, const std::string& service, const std::string& scene_id,
                  bool with_rf)
      : with_rf_(with_rf) {
    if (path.empty()) return;
    v1::RecordHeader header;
    header.set_kind("acquire");
    header.set_client("teletact-client");
    header.set_service(service);
    header.set_scene_id(scene_id);
    header.set_unix_time_s(std::time(nullptr));
    writer_.emplace(path, header);
  }
  void request(std::uint32_t call, const v1::EstimateRequest& request) {
    if (with_rf_ || request.has_acquisition()) append(call, request);
  }
  void response(std::uint32_t call, const v1::EstimateResponse& response) {
    if (response.has_map() && !with_rf_) return;  // maps belong to a recording that can be replayed
    append(call, response);
  }
  void window(std::uint32_t call, const v1::WindowTiming& timing) { append(call, timing); }
  void info(const v1::GetInfoResponse& info) { append(0, info); }
  // What is said of the acquisition.
  void note(const std::string& text) {
    if (!writer_) return;
    v1::RecordEntry entry;
    entry.set_monotonic_ns(monotonic_ns());
    entry.mutable_log()->set_warning(true);
    entry.mutable_log()->set_text("patient side: " + text);
    writer_->append(std::move(entry));
  }
  void close(const v1::Scene& scene) {
    append(0, scene);
    if (writer_) writer_->close();
  }
  bool recording() const { return writer_.has_value(); }

 private:
  template <class Message>
  void append(std::uint32_t call, const Message& message) {
    if (writer_) writer_->append_waiting(recorded(message, monotonic_ns(), call));
  }
  std::optional<RecordWriter> writer_;
  bool with_rf_;
};

}  // namespace teletact::client
