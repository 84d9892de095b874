#include "service/rpc/status.h"

#include <spdlog/spdlog.h>

#include <array>
#include <new>
#include <stdexcept>
#include <system_error>

#include "service/access/access_table.h"
#include "service/base/memory.h"
#include "service/device/device.h"
#include "service/imaging/tracking/measured.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

grpc::StatusCode code_of(ErrorKind kind) {
  // By ErrorKind.
  constexpr std::array kCodes{grpc::StatusCode::NOT_FOUND,
                              grpc::StatusCode::ALREADY_EXISTS,
                              grpc::StatusCode::RESOURCE_EXHAUSTED,
                              grpc::StatusCode::FAILED_PRECONDITION,
                              grpc::StatusCode::ABORTED,
                              grpc::StatusCode::UNAVAILABLE,
                              grpc::StatusCode::CANCELLED,
                              grpc::StatusCode::DEADLINE_EXCEEDED};
  return kCodes.at(static_cast<std::size_t>(kind));
}

}  // namespace

grpc::Status status_of(std::exception_ptr error) noexcept {
  try {
    std::rethrow_exception(error);
  } catch (const Error& e) {
    return {code_of(e.kind), e.what()};
  } catch (const AccessRefused& e) {
    const bool known = e.why == AccessRefused::Why::kDenied;
    return {known ? grpc::StatusCode::PERMISSION_DENIED : grpc::StatusCode::UNAUTHENTICATED, e.what()};
  } catch (const std::invalid_argument& e) {
    return {grpc::StatusCode::INVALID_ARGUMENT, e.what()};
  } catch (const TrackingError& e) {
    return {grpc::StatusCode::FAILED_PRECONDITION, e.what()};
  } catch (const MemoryRefused& e) {
    return {grpc::StatusCode::RESOURCE_EXHAUSTED, e.what()};
  } catch (const DeviceMemoryError& e) {
    spdlog::error("event=device_out_of_memory error=\"{}\"", e.what());
    return {grpc::StatusCode::RESOURCE_EXHAUSTED, e.what()};
  } catch (const std::domain_error& e) {
    // Numbers that are each allowed and together beyond what double carries through the arithmetic.
    return {grpc::StatusCode::INVALID_ARGUMENT,
            std::string(e.what()) +
                "; the numbers sent span too much for double: check moduli, sizes and poisson_ratio"};
  } catch (const std::bad_alloc&) {
    return {grpc::StatusCode::RESOURCE_EXHAUSTED, "out of memory; send a smaller request"};
  } catch (const std::system_error& e) {
    if (e.code() == std::errc::resource_unavailable_try_again)
      return {grpc::StatusCode::RESOURCE_EXHAUSTED, "no thread is to be had; try again later"};
    spdlog::error("event=internal_error error=\"{}\"", e.what());
    return {grpc::StatusCode::INTERNAL, e.what()};
  } catch (const std::exception& e) {
    spdlog::error("event=internal_error error=\"{}\"", e.what());
    return {grpc::StatusCode::INTERNAL, e.what()};
  } catch (...) {
    return {grpc::StatusCode::INTERNAL, "unknown failure"};
  }
}

const char* name_of(grpc::StatusCode code) {
  constexpr std::array kNames{
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  const auto at = static_cast<std::size_t>(code);
  return at < kNames.size() ? kNames[at] : "UNKNOWN";
}

}  // namespace teletact::service
