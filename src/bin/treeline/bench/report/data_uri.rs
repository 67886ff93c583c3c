//! Pictures inside a page: bytes in, `data:` URI out.

use crate::options::{ToolError, ToolResult};
use std::path::Path;

/// Reads a picture; its kind is that of its file name.
pub fn picture_uri(path: &Path) -> ToolResult<String> {
    let message = |text: String| ToolError::Message(format!("picture {}: {text}", path.display()));
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let kind = match &*extension {
        "png" => "png",
        "jpg" | "jpeg" => "jpeg",
        "webp" => "webp",
        other => {
            return Err(message(format!("`{other}` is no kind of picture; give png, jpg or webp")));
        }
    };
    let bytes = std::fs::read(path).map_err(|error| message(error.to_string()))?;
    Ok(format!("data:image/{kind};base64,{}", base64(&bytes)))
}

/// RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            // Three bytes are four letters of six bits; letters of missing bytes alone are padding.
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= group.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_become_the_letters_of_the_standard() {
        // The test vectors of RFC 4648, section 10.
        for (bytes, expected) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), expected);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn pictures_that_cannot_be_shown_are_errors_with_their_name() {
        let missing = picture_uri(Path::new("no/such.png")).expect_err("is missing").to_string();
        assert!(missing.contains("no/such.png"), "{missing}");
        let kind = picture_uri(Path::new("picture.exr")).expect_err("is unknown").to_string();
        assert!(kind.contains("`exr`"), "{kind}");
    }
}
