#include "service/rpc/call_of_connection.h"

#include <fmt/format.h>

#include "service/rpc/call_headers.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

class CountedCall final : public grpc::experimental::Interceptor {
 public:
  CountedCall(Connections& connections, const grpc::ServerContextBase& context)
      : context_(context), call_(connections, context, true) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    using Point = grpc::experimental::InterceptionHookPoints;
    if (methods->QueryInterceptionHookPoint(Point::POST_RECV_CLOSE) && context_.IsCancelled()) call_.waste();
    methods->Proceed();
  }

 private:
  const grpc::ServerContextBase& context_;
  CallOfConnection call_;
};

}  // namespace

void CallOfConnection::vouch() {
  if (!connection_ || connection_->vouched()) return;
  const auto peer = context_.auth_context();
  connections_.vouch(*connection_, identity_of(*peer), peer);
}

// A stream counts itself: its every message would pass here.
grpc::experimental::Interceptor* CountCalls::CreateServerInterceptor(
    grpc::experimental::ServerRpcInfo* call) {
  if (call->type() == grpc::experimental::ServerRpcInfo::Type::BIDI_STREAMING) return nullptr;
  return new CountedCall(connections_, *call->server_context());
}

void require_short_headers(const grpc::ServerContextBase& context) {
  constexpr std::size_t kBeside = 32;  // as HTTP/2 counts them
  std::size_t bytes = 0;
  for (const auto& [name, value] : context.client_metadata()) bytes += name.size() + value.size() + kBeside;
  if (bytes > kMaxHeaderBytes)
    throw Error(ErrorKind::kExhausted,
                fmt::format("metadata: {} bytes are more than the {} that this service takes", bytes,
                            kMaxHeaderBytes));
}

}  // namespace teletact::service
