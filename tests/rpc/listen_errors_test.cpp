// Why an address cannot be listened on: each error in its own words.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <string>

#include "service/rpc/address.h"

namespace teletact::service {
namespace {

std::string why_not(const std::string& listen) {
  ListenOptions options;
  options.listen = listen;
  options.allow_insecure_remote = true;
  try {
    prepare_address(options);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no error";
}

TEST(ListenErrors, Ipv6WithoutBracketsIsNamed) {
  for (const char* bare : {"::1:50051", ":::50051", "fe80::1:50051"})
    EXPECT_NE(why_not(bare).find("an IPv6 address stands in brackets"), std::string::npos) << why_not(bare);
  EXPECT_NE(why_not(":80").find("the host is missing"), std::string::npos) << why_not(":80");
  EXPECT_EQ(parse_address("--listen", "[::1]:0").host, "::1");
}

TEST(ListenErrors, AddressesOfOthersAreNotInUse) {
  const std::string others = why_not("192.0.2.1:50051");  // for documents (RFC 5737): nobody's
  EXPECT_NE(others.find("Cannot assign requested address: it is not this machine's"), std::string::npos)
      << others;
}

// As a user who may not: a process of its own gives up what it may.
TEST(ListenErrors, PortsOfRootAreDenied) {
  int first_for_all = 1024;
  std::ifstream("/proc/sys/net/ipv4/ip_unprivileged_port_start") >> first_for_all;
  const std::string expected =
      first_for_all > 80 ? "Permission denied: ports below 1024 take root" : "no error";
  EXPECT_EXIT(
      {
        constexpr unsigned kNobody = 65534;
        if (::getuid() == 0 && (::setgid(kNobody) != 0 || ::setuid(kNobody) != 0)) std::exit(1);
        std::fprintf(stderr, "%s", why_not("127.0.0.1:80").c_str());
        std::exit(0);
      },
      testing::ExitedWithCode(0), expected);
}

}  // namespace
}  // namespace teletact::service
