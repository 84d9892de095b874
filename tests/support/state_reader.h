// A plain reader of a stream of states with a credit of one: acknowledges each before it reads the next.
#pragma once

#include <grpcpp/grpcpp.h>

#include <cstdint>
#include <memory>
#include <utility>

namespace teletact {

// `Request` has `acknowledged`, `State` has `state`.
template <class Request, class State>
class StateReader {
 public:
  using Stream = std::unique_ptr<grpc::ClientReaderWriterInterface<Request, State>>;
  StateReader(Stream stream, const Request& first) : stream_(std::move(stream)) { send(first); }
  bool send(const Request& request) { return stream_->Write(request); }
  bool read_on(State* state) { return stream_->Read(state); }  // without acknowledging
  bool read(State* state) {
    if (last_ > 0) {
      Request request;
      request.set_acknowledged(last_);
      send(request);
    }
    if (!read_on(state)) return false;
    last_ = state->state();
    return true;
  }
  // Reads what is left.
  grpc::Status finish() {
    for (State state; read(&state);) continue;
    return stream_->Finish();
  }

 protected:
  const Stream stream_;

 private:
  std::uint64_t last_ = 0;
};

}  // namespace teletact
