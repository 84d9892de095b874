#include "client/watch/sources.h"

#include <google/protobuf/io/coded_stream.h>
#include <poll.h>
#include <sys/socket.h>

#include <chrono>
#include <memory>
#include <utility>

#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/link/retry.h"
#include "client/link/scenes.h"
#include "client/link/unix_socket.h"

namespace teletact::client {
namespace {

constexpr std::uint32_t kMaxEntryBytes = 16 << 20;

void nap(double wait_s, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(wait_s);
  while (!stop && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

// Takes entries off the front of what came. None: the rest is a part of one. Throws when it is none.
bool next_entry(std::string& bytes, std::size_t& at, v1::RecordEntry& entry) {
  google::protobuf::io::CodedInputStream coded(reinterpret_cast<const std::uint8_t*>(bytes.data()) + at,
                                               static_cast<int>(bytes.size() - at));
  std::uint32_t size = 0;
  if (!coded.ReadVarint32(&size)) return false;
  if (size > kMaxEntryBytes) throw std::runtime_error("an entry of " + std::to_string(size) + " bytes");
  const auto begin = static_cast<std::size_t>(coded.CurrentPosition());
  if (bytes.size() - at - begin < size) return false;
  if (!entry.ParseFromArray(bytes.data() + at + begin, static_cast<int>(size)))
    throw std::runtime_error("what came is no entry of a session");
  at += begin + size;
  return true;
}

}  // namespace

PublishedSource::PublishedSource(std::string path, std::string name, bool first, View& view)
    : path_(std::move(path)), name_(std::move(name)), first_(first), view_(view), thread_([this] {
        run();
      }) {}

PublishedSource::~PublishedSource() {
  stop_ = true;
  thread_.join();
}

void PublishedSource::run() {
  constexpr double kRetryS = 0.2;
  view_.tell(name_, "waiting for " + path_);
  while (!stop_) {
    const FileDescriptor file = connect_to(path_);
    if (!file) {
      nap(kRetryS, stop_);
      continue;
    }
    std::string why = "ended";
    try {
      read(file.get());
    } catch (const std::exception& error) {
      why = std::string("broken off: ") + error.what();
    }
    if (first_) view_.complete_row();
    view_.tell(name_, why);
    nap(kRetryS, stop_);
  }
}

void PublishedSource::read(int file) {
  std::string bytes;
  std::vector<char> buffer(1 << 16);
  std::size_t at = 0;
  v1::RecordEntry entry;
  while (!stop_) {
    pollfd polled{file, POLLIN, 0};
    if (::poll(&polled, 1, 50) <= 0) continue;
    const ssize_t got = ::recv(file, buffer.data(), buffer.size(), 0);
    if (got <= 0) return;
    bytes.append(buffer.data(), static_cast<std::size_t>(got));
    while (next_entry(bytes, at, entry)) {
      if (entry.has_header()) {
        if (entry.header().version() != kRecordingVersion)
          throw std::runtime_error("it is of version " + std::to_string(entry.header().version()) +
                                   ", and this client reads version " + std::to_string(kRecordingVersion));
        if (first_) view_.restart();
        view_.tell(name_, "live");
      }
      view_.take(entry);
    }
    bytes.erase(0, std::exchange(at, 0));
  }
}

SceneSource::SceneSource(std::string address, Credentials credentials, std::string scene_id, View& view)
    : address_(std::move(address)),
      credentials_(std::move(credentials)),
      scene_id_(std::move(scene_id)),
      view_(view),
      thread_([this] { run(); }) {}

SceneSource::~SceneSource() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    if (context_ != nullptr) context_->TryCancel();
  }
  thread_.join();
}

SceneSource::Wanted SceneSource::wanted() const {
  return {address_.empty() ? view_.header().service() : address_,
          scene_id_.empty() ? view_.header().scene_id() : scene_id_, view_.session_id()};
}

void SceneSource::run() {
  Backoff backoff(kRetryS, kMaxRetryS);
  Wanted before;
  for (double wait_s = kRetryS; !stop_; nap(wait_s, stop_)) {
    wait_s = kRetryS;
    const Wanted now = wanted();
    if (now.address != before.address || now.scene_id != before.scene_id) view_.look_away(true);
    if (now != before) backoff.restart();
    before = now;
    if (now.scene_id.empty() || !address_problem(now.address).empty()) continue;
    const grpc::Status status = look_on(now);
    view_.look_away();
    if (status.ok()) continue;
    view_.tell("service_state", describe(status));
    // A service that starts again is looked at soon.
    if (status.error_code() == grpc::StatusCode::UNAVAILABLE)
      backoff.restart();
    else
      wait_s = backoff.next_s();
  }
}

grpc::Status SceneSource::look_on(const Wanted& at) {
  // A new connection each time: the old one may be half-open.
  const auto stub = v1::Palpation::NewStub(make_channel(at.address, credentials_));
  grpc::ClientContext context;
  name_scene(context, at.scene_id);
  {
    const std::lock_guard lock(mutex_);
    if (stop_) return grpc::Status::OK;
    context_ = &context;
  }
  const auto stream = stub->Observe(&context);
  v1::ObserveRequest request;
  v1::ObserveOpen& open = *request.mutable_open();
  open.set_scene_id(at.scene_id), open.set_session_id(at.session_id);
  open.set_windows(true), open.set_surface(true);
  for (const char* map : {"youngs_modulus", "youngs_modulus_log_std", "valid", "b_mode"}) open.add_maps(map);
  bool goes_on = true;
  for (v1::Observation seen; goes_on && stream->Write(request) && stream->Read(&seen);) {
    view_.tell("service_state", "answers");
    view_.take_observed(seen);
    request.set_acknowledged(seen.state());
    goes_on = wanted() == at;
  }
  if (!goes_on) context.TryCancel();
  const grpc::Status status = stream->Finish();
  const std::lock_guard lock(mutex_);
  context_ = nullptr;
  return goes_on && !stop_ ? status : grpc::Status::OK;
}

}  // namespace teletact::client
