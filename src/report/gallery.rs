//! Small images with captions.

use super::html::{Html, add, escape};

/// Small images with a caption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The images as data URIs (see [`thumbnail`](super::thumbnail)), shown beside each other.
    pub images: Vec<String>,
    /// The title.
    pub title: String,
    /// Figures under the title; may be empty.
    pub note: String,
}

/// Returns the pictures in rows, as many beside each other as fit.
pub fn gallery(pictures: &[Picture]) -> Html {
    let mut text = String::from("<div class=\"gallery\">\n");
    for Picture { images, title, note } in pictures {
        let title = escape(title);
        text.push_str("<figure>");
        text.push_str("<div class=\"pair\">");
        for address in images {
            add(&mut text, format_args!("<img src=\"{}\" alt=\"{title}\">", escape(address)));
        }
        add(
            &mut text,
            format_args!("</div><figcaption><b>{title}</b> {}</figcaption></figure>\n", escape(note)),
        );
    }
    text.push_str("</div>\n");
    Html::raw(text)
}
