//! URIs in glTF files: `data:` URIs → bytes, anything else → a decoded relative path. Linear in the length.

/// What a URI stands for.
#[derive(Debug, PartialEq)]
pub(super) enum Uri {
    /// Embedded bytes.
    Data(Vec<u8>),
    /// A path relative to the model, percent-decoded.
    Path(String),
}

/// Resolves a URI. The error says why it cannot be.
pub(super) fn resolve(uri: &str) -> Result<Uri, String> {
    if let Some(rest) = strip_prefix_ignore_case(uri, "data:") {
        let (head, body) =
            rest.split_once(',').ok_or("its data: URI has no comma before the data")?;
        let bytes = percent_decode(body);
        let is_base64 = head.to_ascii_lowercase().ends_with(";base64");
        return Ok(Uri::Data(if is_base64 { decode_base64(&bytes)? } else { bytes }));
    }
    if uri.contains("://") || strip_prefix_ignore_case(uri, "file:").is_some() {
        return Err(format!("`{uri}` is not a relative path; download it beside the model"));
    }
    if uri.is_empty() {
        return Err("its path is empty".to_owned());
    }
    String::from_utf8(percent_decode(uri))
        .map(Uri::Path)
        .map_err(|_| format!("`{uri}` is not UTF-8 after percent decoding"))
}

fn strip_prefix_ignore_case<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let head = text.get(..prefix.len())?;
    head.eq_ignore_ascii_case(prefix).then(|| &text[prefix.len()..])
}

/// `%41` → `A` (RFC 3986 §2.1); a `%` that no two hexadecimal digits follow stays, as careless exporters mean it.
fn percent_decode(text: &str) -> Vec<u8> {
    let digit = |b: Option<&u8>| b.and_then(|&b| char::from(b).to_digit(16));
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let escaped = (bytes[i] == b'%')
            .then(|| Some(digit(bytes.get(i + 1))? << 4 | digit(bytes.get(i + 2))?))
            .flatten();
        match escaped {
            Some(byte) => {
                out.push(byte as u8);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    out
}

/// Base64 with the standard alphabet (RFC 4648 §4); padding may be left out, white space is skipped.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for (i, &c) in text.iter().enumerate() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => break,
            c if c.is_ascii_whitespace() => continue,
            _ => return Err(format!("byte {i} of its data: URI is not base64")),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
        }
    }
    // Six bits alone make no byte: a letter was lost.
    if count == 6 {
        return Err("its data: URI ends within a base64 byte".to_owned());
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_every_remainder_decodes() {
        for (text, bytes) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg", "foob")]
        {
            let uri = format!("data:application/octet-stream;base64,{text}");
            assert_eq!(resolve(&uri), Ok(Uri::Data(bytes.as_bytes().to_vec())));
        }
        assert_eq!(resolve("data:;base64,/+8="), Ok(Uri::Data(vec![0xff, 0xef])));
        assert!(resolve("data:;base64,Zm9vY").unwrap_err().contains("ends within"));
        assert!(resolve("data:;base64,Zm9$").unwrap_err().contains("byte 3"));
        assert!(resolve("data:;base64").unwrap_err().contains("comma"));
    }

    #[test]
    fn paths_are_percent_decoded_and_must_be_relative() {
        let path = |text: &str| Ok(Uri::Path(text.to_owned()));
        assert_eq!(resolve("my%20bark.png"), path("my bark.png"));
        assert_eq!(resolve("rinde%C3%A4.png"), path("rindeä.png"));
        assert_eq!(resolve("100%.png"), path("100%.png"));
        assert_eq!(resolve("data:,a%41"), Ok(Uri::Data(b"aA".to_vec())));
        assert!(resolve("https://example.org/a.bin").is_err());
        assert!(resolve("").is_err());
        assert!(resolve("%ff").is_err());
    }
}
