// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "jade/serve/address.h"

namespace jade::serve {

/// Parts of a request that the gate checks; an absent header is empty.
struct Knock {
  std::string path;
  std::string host, origin;
  std::string fetch_site, fetch_mode;  ///< Sec-Fetch-Site and -Mode, which browsers set
  std::string token;
  std::string content_length, transfer_encoding;
};

struct Refusal {
  int status;          ///< of HTTP
  std::string reason;  ///< one line for the client
};

/// 128 random bits as 32 hexadecimal digits.
std::string make_token();

/// Access control. A page of another site that is open in the same browser must reach nothing:
/// neither through its own requests (Origin, Sec-Fetch-Site) nor through a host name that it
/// resolves to this machine (Host). Requests have almost no body.
class Gate {
 public:
  /// @param token  that every request must contain; empty: none
  Gate(const Address& address, std::string token);

  /// Returns no value if the request is allowed.
  std::optional<Refusal> refuse(const Knock& knock) const;

  /// The largest body.
  static constexpr long kLargestBody = 1024;

 private:
  bool is_ours(const std::string& host) const;

  bool loopback_;
  std::string token_, machine_;
};

}  // namespace jade::serve
