// No code: what stands behind the precompiled headers of the tests.
// SPDX-License-Identifier: Apache-2.0
